"""The report is one valid file: it says every number with its reason and asks nothing of the network."""

import base64
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.export import render_report
from nerfmodal.export.report import measured
from nerfmodal.types import Outcome, Reason, ScanResult
from PIL import Image

from tests.fixtures.scans import small_cloud, small_frame, small_result, small_spec

RESULT, SPEC = small_result(), small_spec()
VOID = {"meta", "img", "br", "link", "hr", "input"}


class Page(HTMLParser):
    """Tags in order, with a check that every opened one is closed."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.words: list[str] = []

    def handle_starttag(self, tag, attrs):
        self.attributes += [(name, value or "") for name, value in attrs]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def page(result: ScanResult = RESULT, pictures: tuple[Path, ...] = (), spec=SPEC) -> Page:
    parsed = Page()
    parsed.feed(render_report(spec, result, small_frame(), small_cloud(), pictures))
    assert parsed.open == []
    return parsed


@pytest.fixture
def pictures(tmp_path: Path) -> tuple[Path, ...]:
    names = ("cloud", "leaf_0_shapes", "trunk_shapes", "elsewhere_shapes")
    for index, name in enumerate(names):
        Image.fromarray(np.full((4, 4, 3), 40 * index, dtype=np.uint8)).save(tmp_path / f"{name}.png")
    return tuple(tmp_path / f"{name}.png" for name in names)


def test_every_number_stands_with_its_deviation_and_every_reason_in_words():
    words = " ".join(page().words)
    assert "2.1700 ± 0.0030" in words
    assert "1.00 ± 0.12" in words
    assert Reason.HARMONIC.value in words
    assert "✗ rejected" in words


def test_what_was_measured_is_said():
    words = " ".join(page().words)
    for fact in ("90 frames at 30 frames/s, 3 s", "14 cameras, 64 × 48 px", "leaf_0: 1, trunk: 1", "up to 13.5 Hz"):
        assert fact in words


def test_pictures_are_inside_the_file_byte_for_byte(pictures):
    sources = [value for name, value in page(pictures=pictures).attributes if name == "src"]
    embedded = [base64.b64decode(source.removeprefix("data:image/png;base64,")) for source in sources]
    assert embedded == [path.read_bytes() for path in pictures[:3]]


def test_nothing_is_fetched_from_anywhere(pictures):
    links = [value for name, value in page(pictures=pictures).attributes if name in {"src", "href", "data"}]
    assert links
    assert all(link.startswith(("data:image/png;base64,", "#")) for link in links)


def test_a_scan_without_modes_says_why():
    none = replace(RESULT, organs=(), outcome=Outcome.TOO_FEW_FRAMES)
    assert Outcome.TOO_FEW_FRAMES.value in " ".join(page(none).words)


def test_names_cannot_break_out_of_the_page():
    leaf = RESULT.organs[0]
    hostile = replace(RESULT, organs=(replace(leaf, organ="<script>alert(1)</script>"),))
    html = render_report(SPEC, hostile, None, None, ())
    assert "<script>" not in html


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [
        (None, None, "–"),
        (0.0098, 0.003, "0.98 ± 0.30"),
        (0.05, None, "5"),
        (0.05, 0.0, "5"),
        (-0.001, 0.02, "-0.1 ± 2.0"),
    ],
)
def test_a_value_has_the_digits_its_uncertainty_allows(value, std, words):
    assert measured(value, std, 100.0) == words
