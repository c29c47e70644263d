"""Pictures survive a grey print and a colour-blind reader: lightness alone tells their marks apart.

Contrast ratios are those of WCAG 2.1 (relative luminance of sRGB): 4.5 for words, 3 for marks on white. Colour vision
deficiencies are simulated with the matrices of Machado, Oliveira and Fernandes (2009) for full severity.
"""

import numpy as np
import pytest
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from nerfmodal.figures import eigenvalues, magnified_frames, modal_coordinates, mode_shapes, stabilisation
from nerfmodal.figures.style import BLUE, CYCLE, GREY, SIGNED_MAP, VERMILLION
from nerfmodal.types import Diagram

from tests.fixtures.scans import small_result
from tests.unit.figures.test_stabilisation import with_diagram

LEAF = small_result().organs[0]
DEFICIENCIES = {
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


def linear(color) -> np.ndarray:
    parts = np.asarray(to_rgb(color))
    return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)


def luminance(color) -> float:
    return float(linear(color) @ (0.2126, 0.7152, 0.0722))


def contrast(first, second) -> float:
    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("color", [BLUE, VERMILLION, GREY])
def test_marks_stand_out_from_white_paper(color):
    assert contrast(color, "white") >= 3


@pytest.mark.parametrize(
    "figure",
    [mode_shapes(LEAF), magnified_frames(LEAF), modal_coordinates(LEAF, "free_decay"), eigenvalues(LEAF)],
    ids=["shapes", "magnified", "coordinates", "eigenvalues"],
)
def test_words_can_be_read(figure):
    panels = [item for axes in figure.axes for item in (axes.title, axes.xaxis.label, axes.yaxis.label, *axes.texts)]
    words = [text for text in (*figure.texts, *panels) if text.get_text()]
    assert words
    assert min(contrast(text.get_color(), "white") for text in words) >= 4.5


def lightness(colors: np.ndarray) -> np.ndarray:
    """CIE L* of rows of sRGB."""
    y = np.array([luminance(color) for color in colors])
    return np.where(y > 216 / 24389, 116 * np.cbrt(y) - 16, y * 24389 / 27)


def test_colour_of_displacement_rises_evenly_in_lightness():
    steps = np.diff(lightness(colormaps[SIGNED_MAP](np.linspace(0, 1, 33))[:, :3]))
    assert steps.min() > 0
    assert steps.max() / steps.min() < 3


@pytest.mark.parametrize("deficiency", DEFICIENCIES)
def test_ends_of_the_displacement_stay_apart_for_every_eye(deficiency):
    ends = colormaps[SIGNED_MAP]([0.0, 0.5, 1.0])[:, :3]
    seen = np.clip([DEFICIENCIES[deficiency] @ linear(color) for color in ends], 0, 1)
    y = seen @ (0.2126, 0.7152, 0.0722)
    assert (y[1] + 0.05) / (y[0] + 0.05) > 2.5
    assert (y[2] + 0.05) / (y[1] + 0.05) > 2.5


@pytest.mark.parametrize("deficiency", DEFICIENCIES)
def test_neighbours_in_the_cycle_stay_apart_for_every_eye(deficiency):
    seen = np.clip([DEFICIENCIES[deficiency] @ linear(color) for color in CYCLE], 0, 1)
    assert np.linalg.norm(np.diff(seen, axis=0), axis=1).min() > 0.15


def test_a_line_that_means_something_else_has_another_dash_or_mark():
    axes = modal_coordinates(LEAF, "free_decay").axes
    history, envelope = axes[0].lines[:2]
    assert (history.get_linestyle(), envelope.get_linestyle()) == ("-", "--")
    spectrum, frequency = axes[1].lines
    assert spectrum.get_linestyle() != frequency.get_linestyle()
    diagram = Diagram(
        orders=np.array([2, 4]),
        frequencies=np.array([2.1, 2.2]),
        damping_ratios=np.zeros(2),
        stable=np.array([False, True]),
    )
    poles = stabilisation(with_diagram(diagram)).axes[0].lines[:2]
    assert {line.get_marker() for line in poles} == {"x", "o"}
