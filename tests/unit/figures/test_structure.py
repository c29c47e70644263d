"""Shared motions are drawn with every organ at its place in the global shape."""

from dataclasses import replace

import numpy as np
import pytest
from nerfmodal.export import render_report
from nerfmodal.figures import structure_shapes
from nerfmodal.figures.structure import drawn_structure
from nerfmodal.types import StructureMode, Verdict

from tests.fixtures.scans import small_result, small_spec

LEAF, TRUNK = small_result().organs


def shared() -> StructureMode:
    """The trunk moves by 1 along x, the leaf by -0.5 along z."""
    positions = [TRUNK.displacement.sensors.positions, LEAF.displacement.sensors.positions]
    motions = [np.tile([1.0, 0, 0], (500, 1)), np.tile([0, 0, -0.5], (900, 1))]
    return StructureMode(
        frequency=1.07,
        frequency_std=0.004,
        damping_ratio=0.01,
        damping_std=0.001,
        organs=("trunk", "leaf_0"),
        modes=(0, 0),
        amplitudes=np.array([1.0, -0.5]),
        phases=np.array([0.0, np.pi]),
        coherences=np.ones(2),
        coordinates=TRUNK.model.coordinates[:, 0],
        positions=np.concatenate(positions),
        shape=np.concatenate(motions),
        verdict=Verdict.DOUBTFUL,
    )


RESULT = replace(small_result(), structure=(shared(),))


def test_each_organ_moves_as_the_global_shape_says():
    drawn = drawn_structure(shared(), RESULT.organs)
    trunk = np.abs(drawn.rest[:, :2]).max(axis=1) < 0.05
    np.testing.assert_array_equal(drawn.motion[trunk], np.tile([1.0, 0, 0], (trunk.sum(), 1)))
    np.testing.assert_array_equal(drawn.motion[~trunk], np.tile([0, 0, -0.5], ((~trunk).sum(), 1)))
    assert drawn.triangles.max() == len(drawn.rest) - 1
    np.testing.assert_allclose(drawn.signed[trunk], 1)
    np.testing.assert_allclose(drawn.signed[~trunk], -0.5)
    owners = trunk[drawn.triangles]
    assert (owners.all(axis=1) | ~owners.any(axis=1)).all()  # no triangle joins two organs


def test_picture_names_frequency_organs_and_verdict():
    titles = [axes.get_title() for axes in structure_shapes(RESULT).axes]
    assert "1.0700 ± 0.0040 Hz: 2 organs [doubtful]" in titles


@pytest.mark.parametrize("result", [RESULT, small_result()], ids=["shared", "nothing shared"])
def test_report_tells_shared_motions_where_there_are_some(result):
    html = render_report(small_spec(), result, None, None, ())
    assert ("trunk: 1, leaf_0: -0.5" in html) == bool(result.structure)
    assert ('href="#structure"' in html) == ('id="structure"' in html) == bool(result.structure)
