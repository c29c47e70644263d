"""The report is one valid file: it says every number with its reason and asks nothing of the network."""

import base64
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from nerfmodal.export import render_report
from nerfmodal.export.numbers import interval, measured
from nerfmodal.export.words import VERDICTS
from nerfmodal.spec import PlantSpec
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
    films = ("leaf_0_mode_0.mp4", "leaf_0_mode_0.gif", "leaf_0_mode_7.mp4")
    for name in films:
        (tmp_path / name).write_bytes(name.encode())
    return (*(tmp_path / f"{name}.png" for name in names), *(tmp_path / name for name in films))


def test_every_number_stands_with_its_deviation_and_every_reason_in_words():
    words = " ".join(page().words)
    assert "2.1700 ± 0.0030" in words
    assert "1.00 ± 0.12" in words
    assert Reason.HARMONIC.value in words
    assert "✗ rejected" in words
    assert "1 other" in words  # method saw the first mode


def test_what_was_measured_is_said():
    words = " ".join(page().words)
    for fact in ("90 frames at 30 frames/s, 3 s", "14 cameras, 64 × 48 px", "leaf_0: 1, trunk: 1", "up to 13.5 Hz"):
        assert fact in words


def embedded(attributes: list[tuple[str, str]], kind: str) -> list[bytes]:
    """What stands in the page as data of this media type."""
    sources = [value for name, value in attributes if name == "src" and value.startswith(f"data:{kind};base64,")]
    return [base64.b64decode(source.partition(",")[2]) for source in sources]


def test_pictures_are_inside_the_file_byte_for_byte(pictures):
    assert embedded(page(pictures=pictures).attributes, "image/png") == [path.read_bytes() for path in pictures[:3]]


def test_film_of_a_mode_plays_inside_the_file(pictures):
    parsed = page(pictures=pictures)
    assert embedded(parsed.attributes, "video/mp4") == [b"leaf_0_mode_0.mp4"]
    assert "Mode 0, 2.17 Hz" in " ".join(parsed.words)


def test_nothing_is_fetched_from_anywhere(pictures):
    links = [value for name, value in page(pictures=pictures).attributes if name in {"src", "href", "data", "poster"}]
    assert links
    assert all(link.startswith(("data:image/png;base64,", "data:video/mp4;base64,", "#")) for link in links)
    html = render_report(SPEC, RESULT, small_frame(), small_cloud(), pictures)
    assert not re.search(r"https?://|url\(|@import|<script|<link", html)


def test_every_link_in_the_page_leads_somewhere(pictures):
    attributes = page(pictures=pictures).attributes
    targets = {value for name, value in attributes if name == "id"}
    assert {value[1:] for name, value in attributes if name == "href"} <= targets


@pytest.mark.parametrize(
    ("given", "found", "words"),
    [
        ("auto", "free_decay", "free decay (pulled and let go); recognised: damped sinusoids explain nearly all"),
        ("auto", "ambient", "ambient (wind or another random force); recognised: damped sinusoids leave"),
        ("harmonic", "harmonic", "steady harmonic motion; given in the specification"),
    ],
)
def test_excitation_is_said_with_how_it_is_known(given, found, words):
    spec = SPEC.model_copy(update={"identification": SPEC.identification.model_copy(update={"excitation": given})})
    assert words in " ".join(page(replace(RESULT, excitation=found), spec=spec).words)


def test_it_says_how_to_cite_it_and_what_each_verdict_means():
    words = " ".join(page().words)
    assert "Full-Field 3D Structural Dynamics via Neural Radiance Fields" in words
    assert f"specification SHA-256 {'ab' * 8}, seed 7, 2025-01-02" in words
    assert "4 modes of 2 organs: 2 accepted, 1 doubtful, 1 rejected" in words
    assert all(meaning in words for meaning in VERDICTS.values())


def test_which_plant_was_scanned_is_said():
    plant = PlantSpec(id="pot_17", position="bench 3", treatment="drought")
    words = " ".join(page(spec=SPEC.model_copy(update={"plant": plant, "tags": ("week_4",)})).words)
    assert "pot_17, bench 3, drought" in words
    assert "week_4" in words


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here: apt-get install chromium")
def test_in_a_browser_nothing_overflows_a_narrow_window(pictures, tmp_path: Path):
    html = render_report(SPEC, RESULT, small_frame(), small_cloud(), pictures)
    measure = "document.title = document.documentElement.scrollWidth + ' of ' + window.innerWidth"
    (tmp_path / "report.html").write_text(html.replace("</body>", f"<script>{measure}</script></body>"))
    arguments = ["--headless=new", "--no-sandbox", "--disable-gpu", "--window-size=500,900", "--dump-dom"]
    folder = f"--user-data-dir={tmp_path / 'profile'}"
    done = subprocess.run(
        [CHROMIUM, *arguments, folder, f"file://{tmp_path / 'report.html'}"],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    found = re.search(r"<title>(\d+) of (\d+)</title>", done.stdout)
    assert found, done.stderr[-2000:]
    assert int(found[1]) <= int(found[2])


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


@pytest.mark.parametrize(
    ("value", "std", "words"),
    [(2.17, 0.003, "2.1641 … 2.1759"), (2.17, None, "–"), (None, None, "–"), (0.01, 0.02, "-0.029 … 0.049")],
)
def test_an_interval_is_196_deviations_to_both_sides(value, std, words):
    assert interval(value, std) == words
