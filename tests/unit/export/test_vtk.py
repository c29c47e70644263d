"""Displacement vectors for ParaView and CloudCompare: read back by VTK's and trimesh's own readers and by XML here."""

import base64
import struct
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
import trimesh
from nerfmodal.export import write_vectors, write_vtp
from nerfmodal.export.vtp import vtp

from tests.fixtures.scans import LEAF_FREQUENCIES, small_result

LEAF, TRUNK = small_result().organs


def array_of(text: str, name: str, place: str) -> np.ndarray:
    """A plain reader: an array of the file by its name."""
    (element,) = [each for each in ElementTree.fromstring(text).iter("DataArray") if each.get("Name") == name][:1]
    if place:
        element = next(each for each in ElementTree.fromstring(text).find(f".//{place}") if each.get("Name") == name)
    content = base64.b64decode(element.text)
    (size,) = struct.unpack_from("<Q", content)
    assert size == len(content) - 8
    kind = {"Float64": "<f8", "Int64": "<i8"}[element.get("type")]
    return np.frombuffer(content[8:], kind).reshape(-1, int(element.get("NumberOfComponents", 1)))


def test_plain_reader_finds_the_shape_as_world_vectors():
    text = vtp(TRUNK, 0)
    vectors = array_of(text, "displacement", "PointData")
    np.testing.assert_array_equal(vectors, TRUNK.model.mode_shapes[:, :, 0] @ TRUNK.displacement.directions)
    np.testing.assert_array_equal(array_of(text, "positions", "Points"), TRUNK.displacement.sensors.positions)


def vtk_reads(path: Path):
    modules = pytest.importorskip("vtkmodules.vtkIOXML", reason="vtk is not installed")
    reader = modules.vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    return reader.GetOutput()


def test_vtk_reads_a_leaf_as_a_surface_with_vectors(tmp_path: Path):
    read = vtk_reads(write_vtp(LEAF, 1, tmp_path / "leaf_0_1.vtp"))
    support = pytest.importorskip("vtkmodules.util.numpy_support", reason="vtk is not installed")
    vectors = support.vtk_to_numpy(read.GetPointData().GetVectors())
    places = support.vtk_to_numpy(read.GetPoints().GetData())
    np.testing.assert_array_equal(vectors[:, 2], LEAF.model.mode_shapes[:, 0, 1])
    np.testing.assert_array_equal(places, LEAF.displacement.sensors.positions)
    assert read.GetNumberOfPolys() > 1500
    assert read.GetNumberOfLines() == 0
    assert read.GetFieldData().GetArray("natural_frequency_hz").GetValue(0) == LEAF_FREQUENCIES[1]


def test_vtk_reads_a_trunk_as_one_line_along_it(tmp_path: Path):
    read = vtk_reads(write_vtp(TRUNK, 0, tmp_path / "trunk_0.vtp"))
    heights = [read.GetPoint(read.GetCell(0).GetPointId(k))[2] for k in range(read.GetCell(0).GetNumberOfPoints())]
    assert (read.GetNumberOfLines(), read.GetNumberOfPolys(), len(heights)) == (1, 0, 500)
    assert heights in (sorted(heights), sorted(heights, reverse=True))


def test_vectors_are_read_by_trimesh(tmp_path: Path):
    path = write_vectors(LEAF, 0, tmp_path / "leaf_0_0.ply")
    cloud = trimesh.load(path)
    np.testing.assert_allclose(cloud.vertices, LEAF.displacement.sensors.positions, atol=1e-6)
    vertices = cloud.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_allclose(vertices["dz"], LEAF.model.mode_shapes[:, 0, 0], atol=1e-6)
