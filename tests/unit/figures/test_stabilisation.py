"""The stabilisation diagram shows every pole once, by what it is, and the identified modes through them."""

from dataclasses import replace

import numpy as np
from nerfmodal.figures import stabilisation
from nerfmodal.types import Diagram

from tests.fixtures.scans import FRAME_RATE, LEAF_FREQUENCIES, small_result

LEAF = small_result().organs[0]
DIAGRAM = Diagram(
    orders=np.array([2, 4, 4, 6, 6]),
    frequencies=np.array([2.1, 2.17, 7.0, 2.17, 9.6]),
    damping_ratios=np.full(5, 0.01),
    stable=np.array([False, True, False, True, False]),
)


def with_diagram(diagram: Diagram | None):
    return replace(LEAF, opinions=(replace(LEAF.opinions[0], diagram=diagram),))


def test_stable_and_other_poles_are_drawn_apart():
    axes = stabilisation(with_diagram(DIAGRAM)).axes[0]
    other, stable = axes.lines[:2]
    np.testing.assert_array_equal(stable.get_xydata(), [[2.17, 4], [2.17, 6]])
    np.testing.assert_array_equal(other.get_xydata(), [[2.1, 2], [7.0, 4], [9.6, 6]])


def test_modes_stand_at_their_frequencies_and_only_accepted_ones_are_drawn_through():
    lines = stabilisation(with_diagram(DIAGRAM)).axes[0].lines[2:]
    assert [line.get_xdata()[0] for line in lines] == LEAF_FREQUENCIES.tolist()
    assert [line.get_linestyle() for line in lines] == ["-", "--", "--"]


def test_axis_runs_to_half_the_frame_rate_and_names_its_units():
    axes, spectrum = stabilisation(with_diagram(DIAGRAM)).axes
    assert axes.get_xlim() == (0, FRAME_RATE / 2)
    assert (axes.get_xlabel(), spectrum.get_ylabel()) == ("frequency (Hz)", "mm²/Hz")


def test_an_organ_without_such_a_method_says_so():
    (words,) = stabilisation(with_diagram(None)).texts
    assert "No model of rising order" in words.get_text()
