"""Records of clouds from elsewhere: names, numbers, times, units; and each fault with its file, field and remedy."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from nerfmodal import io
from nerfmodal.errors import InvalidClouds
from nerfmodal.types import PointCloud


def write_ascii(path: Path, points: np.ndarray) -> None:
    """A PLY as another program writes it."""
    rows = "\n".join(" ".join(map(repr, row.tolist())) for row in points)
    header = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    header += "".join(f"property float {axis}\n" for axis in "xyz")
    path.write_text(f"{header}end_header\n{rows}\n")


def folder(path: Path, names: Sequence[str], document: dict[str, object] | None = None) -> Path:
    for place, name in enumerate(names):
        write_ascii(path / name, np.full((4, 3), float(place)))
    if document is not None:
        (path / "clouds.json").write_text(json.dumps(document))
    return path


def order(record: io.CloudSequence) -> list[float]:
    return [float(cloud.points[0, 0]) for cloud in record]


def test_a_folder_and_an_archive_give_the_same_clouds(tmp_path: Path) -> None:
    points = np.random.default_rng(0).normal(size=(2, 6, 3))
    for index, cloud in enumerate(points):
        trimmed = PointCloud(points=cloud * 1000, colors=np.zeros((6, 3)), time=index / 30)
        io.write_cloud(tmp_path / f"frame_{index:04d}.ply", trimmed)
    (tmp_path / "clouds.json").write_text(json.dumps({"frame_rate_hz": 30, "unit": "mm"}))
    np.savez(tmp_path / "clouds.npz", frame_rate_hz=30.0, frame_0000=points[0], frame_0001=points[1])
    one, other = io.open_clouds(tmp_path), io.open_clouds(tmp_path / "clouds.npz")
    assert one.frame_rate == other.frame_rate == 30
    for first, second in zip(one, other, strict=True):
        np.testing.assert_allclose(first.points, second.points)
        assert first.time == second.time


def test_files_of_any_name_come_in_natural_order(tmp_path: Path) -> None:
    record = io.open_clouds(folder(tmp_path, ["scan2.PLY", "scan10.PLY", "scan9.PLY"]), frame_rate=10.0)
    assert record.names == ("scan2.PLY", "scan9.PLY", "scan10.PLY")
    assert order(record) == [0.0, 2.0, 1.0]


def test_files_called_frame_are_the_record_and_others_are_not(tmp_path: Path) -> None:
    record = io.open_clouds(folder(tmp_path, ["frame_0.ply", "frame_1.ply", "mesh.ply"]), frame_rate=10.0)
    assert record.names == ("frame_0.ply", "frame_1.ply")


def test_a_skipped_number_is_a_lost_frame(tmp_path: Path) -> None:
    names = [f"frame_{10 * k:04d}.ply" for k in (3, 4, 6, 7)]
    record = io.open_clouds(folder(tmp_path, names, {"frame_rate_hz": 20}))
    np.testing.assert_allclose(record.times, np.array([0, 1, 3, 4]) / 20)
    assert record.missing == (50,)


def test_the_times_of_lost_frames_may_be_listed_too(tmp_path: Path) -> None:
    listed = [0.0, 0.11, 0.19, 0.3]
    names = [f"frame_{k:04d}.ply" for k in (0, 1, 3)]
    record = io.open_clouds(folder(tmp_path, names, {"frame_rate_hz": 10, "times_s": listed}))
    np.testing.assert_allclose(record.times, [0.0, 0.11, 0.3])


def test_names_that_are_clocks_are_no_frame_numbers(tmp_path: Path) -> None:
    record = io.open_clouds(folder(tmp_path, ["1700000033.ply", "1700000066.ply", "1700000101.ply"]), frame_rate=30.0)
    np.testing.assert_allclose(record.times, np.arange(3) / 30)
    assert record.missing == ()


def test_uneven_times_are_used_and_give_the_frame_rate_that_nobody_told(tmp_path: Path) -> None:
    record = io.open_clouds(folder(tmp_path, ["a1.ply", "a2.ply", "a3.ply"], {"times_s": [0.0, 0.1, 0.25]}))
    np.testing.assert_allclose([cloud.time for cloud in record], [0.0, 0.1, 0.25])
    assert record.frame_rate == pytest.approx(8.0)


def test_clouds_tell_their_own_times_unless_all_say_the_same(tmp_path: Path) -> None:
    for index, time in enumerate([0.5, 0.61, 0.7]):
        (tmp_path / "told").mkdir(exist_ok=True)
        (tmp_path / "same").mkdir(exist_ok=True)
        cloud = PointCloud(points=np.zeros((1, 3)), colors=np.zeros((1, 3)), time=time)
        io.write_cloud(tmp_path / f"told/frame_{index}.ply", cloud)
        silent = PointCloud(points=np.zeros((1, 3)), colors=np.zeros((1, 3)), time=0.0)
        io.write_cloud(tmp_path / f"same/frame_{index}.ply", silent)
    np.testing.assert_allclose(io.open_clouds(tmp_path / "told", frame_rate=10.0).times, [0.5, 0.61, 0.7])
    np.testing.assert_allclose(io.open_clouds(tmp_path / "same", frame_rate=10.0).times, [0.0, 0.1, 0.2])


@pytest.mark.parametrize(
    ("unit", "metres"), [("m", 1.0), ("mm", 1e-3), ("Inches", 0.0254), ("feet", 0.3048), ("Millimetres", 1e-3)]
)
def test_every_declared_unit_becomes_metres(tmp_path: Path, unit: str, metres: float) -> None:
    record = io.open_clouds(folder(tmp_path, ["a0.ply", "a1.ply"], {"frame_rate_hz": 10, "unit": unit}))
    assert order(record) == pytest.approx([0.0, metres])
    assert order(io.open_clouds(tmp_path, unit="cm")) == pytest.approx([0.0, 0.01])


def test_organs_may_stand_in_the_clouds_json(tmp_path: Path) -> None:
    organs = [{"name": "stem", "surface": "cylinder"}]
    record = io.open_clouds(folder(tmp_path, ["a0.ply", "a1.ply"], {"frame_rate_hz": 10, "organs": organs}))
    assert [(organ.name, organ.surface) for organ in record.organs] == [("stem", "cylinder")]


@pytest.mark.parametrize(
    ("header", "where", "said"),
    [
        ({"frame_rate_hz": 0}, "clouds.json#/frame_rate_hz", "frame rate is 0"),
        ({"frame_rate_hz": "fast"}, "clouds.json#/frame_rate_hz", "fast"),
        ({}, "clouds.json#/frame_rate_hz", "frame_rate_hz"),
        ({"frame_rate_hz": 30, "unit": "parsec"}, "clouds.json#/unit", "parsec"),
        ({"frame_rate_hz": 30, "times_s": [0.1, 0.1]}, "clouds.json#/times_s", "frame_0001 is at 0.1 s"),
        ({"frame_rate_hz": 30, "times_s": [0.1]}, "clouds.json#/times_s", "1 times for 2 clouds"),
        ({"frame_rate_hz": 30, "times_s": ["x", 1]}, "clouds.json#/times_s", "times"),
        ({"frame_rate_hz": 30, "times_s": [0.0, 33.3]}, "clouds.json#/times_s", "contradict"),
        ({"frame_rate_hz": 30, "organs": [{"name": "a"}, {"name": "a"}]}, "clouds.json#/organs", "two organs"),
        ({"frame_rate_hz": 30, "organs": [{"name": "a", "surface": "cube"}]}, "clouds.json#/organs/0/surface", "Input"),
    ],
)
def test_a_wrong_header_names_its_file_and_key(
    tmp_path: Path, header: dict[str, object], where: str, said: str
) -> None:
    with pytest.raises(InvalidClouds, match=said) as caught:
        io.open_clouds(folder(tmp_path, ["frame_0000.ply", "frame_0001.ply"], header))
    assert str(caught.value.where).endswith(where)
    assert caught.value.hint


@pytest.mark.parametrize("text", ["{", "[1]"])
def test_a_broken_header_names_its_file(tmp_path: Path, text: str) -> None:
    (folder(tmp_path, ["frame_0000.ply"]) / "clouds.json").write_text(text)
    with pytest.raises(InvalidClouds) as caught:
        io.open_clouds(tmp_path)
    assert str(caught.value.where).endswith("clouds.json")


def test_without_a_frame_rate_the_remedy_is_said(tmp_path: Path) -> None:
    with pytest.raises(InvalidClouds, match="frame rate is not known") as caught:
        io.open_clouds(folder(tmp_path, ["a0.ply", "a1.ply"]))
    assert "--frame-rate" in (caught.value.hint or "")


def test_a_folder_without_clouds_and_a_path_that_is_not_there(tmp_path: Path) -> None:
    for path, said in ((tmp_path, "no clouds"), (tmp_path / "nowhere", "does not exist")):
        with pytest.raises(InvalidClouds, match=said):
            io.open_clouds(path, frame_rate=30.0)
    (tmp_path / "broken.npz").write_bytes(b"PK broken")
    with pytest.raises(InvalidClouds, match=r"broken\.npz"):
        io.open_clouds(tmp_path / "broken.npz")


def test_nan_points_are_refused_with_their_file_and_place(tmp_path: Path) -> None:
    points = np.zeros((5, 3))
    points[2, 1] = np.nan
    np.savez(tmp_path / "c.npz", frame_rate_hz=30.0, frame_0000=points)
    write_ascii(tmp_path / "frame_0000.ply", points)
    for path, file in ((tmp_path / "c.npz", "frame_0000"), (tmp_path, "frame_0000.ply")):
        record = io.open_clouds(path, frame_rate=30.0)
        with pytest.raises(InvalidClouds, match="1 of 5 points, the first at point 2, y") as caught:
            list(record)
        assert str(caught.value.where).endswith(file)


def vertex_file(kind: str, order: str, extra: bool) -> bytes:
    """A binary PLY of 50 points, with or without other properties and faces around the coordinates."""
    fields = [("x", kind), ("y", kind), ("z", kind)]
    names = {"f4": "float", "f8": "double", "u1": "uchar"}
    if extra:
        fields = [("intensity", "u1"), *fields, ("nx", "f4")]
    vertices = np.zeros(50, dtype=[(name, order + part) for name, part in fields])
    for axis, name in enumerate("xyz"):
        vertices[name] = np.arange(50) * (axis + 1)
    endian = "little" if order == "<" else "big"
    lines = ["ply", f"format binary_{endian}_endian 1.0", "comment made elsewhere", "element vertex 50"]
    lines += [f"property {names[part]} {name}" for name, part in fields]
    if extra:
        lines += ["element face 0", "property list uchar int vertex_indices"]
    return "\n".join([*lines, "end_header", ""]).encode() + vertices.tobytes()


@pytest.mark.parametrize("kind", ["f4", "f8"])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("extra", [False, True])
def test_binary_files_of_other_programs_are_read(tmp_path: Path, kind: str, order: str, extra: bool) -> None:
    (tmp_path / "cloud.ply").write_bytes(vertex_file(kind, order, extra))
    points = io.read_cloud(tmp_path / "cloud.ply").points
    np.testing.assert_allclose(points, np.arange(50)[:, None] * np.array([1.0, 2.0, 3.0]))


@pytest.mark.parametrize("cut", [0, 3, 700])
def test_a_file_that_ends_early_is_refused(tmp_path: Path, cut: int) -> None:
    write_ascii(tmp_path / "whole.ply", np.random.default_rng(0).normal(size=(50, 3)))
    text = (tmp_path / "whole.ply").read_bytes()
    (tmp_path / "cut.ply").write_bytes(text[: len(text) - 1200 - cut] if cut else b"")
    with pytest.raises(InvalidClouds, match=r"cut\.ply"):
        io.read_cloud(tmp_path / "cut.ply")
