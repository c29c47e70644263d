"""What the how-tos and examples tell a reader to write is taken as it stands."""

import json
import re
from pathlib import Path

import pytest
import yaml
from nerfmodal.io.transforms import parse_camera
from nerfmodal.spec import CaptureSource, ReconstructionSpec, ScanSpec

ROOT = Path(__file__).parents[3]
PAGES = sorted((ROOT / "docs/howto").glob("capture*.md"))
BLOCKS = [
    (page.name, block)
    for page in PAGES
    for block in re.findall(r"```yaml\n(.*?)```", page.read_text(), flags=re.DOTALL)
]


@pytest.mark.parametrize(("page", "block"), BLOCKS)
def test_specifications_are_taken(page: str, block: str) -> None:
    del page
    document = yaml.safe_load(block)
    assert set(document) <= {"name", "source", "reconstruction"}
    CaptureSource.model_validate(document["source"])
    ReconstructionSpec.model_validate(document.get("reconstruction", {}))


@pytest.mark.parametrize("name", ["capture-transforms.md", "capture-videos.md"])
def test_poses_are_taken(name: str) -> None:
    text = (ROOT / "docs/howto" / name).read_text()
    (block,) = re.findall(r"```json\n(.*?)```", text, flags=re.DOTALL)
    document = json.loads(block)
    entries = document.pop("frames", None) or document.pop("cameras")
    for entry in entries:
        parse_camera(entry, document, name)


def test_scales_of_the_table_are_taken() -> None:
    text = (ROOT / "docs/howto/capture-without-poses.md").read_text()
    scales = re.findall(r"^\| `(\{kind:.*?\})` \|", text, flags=re.MULTILINE)
    assert len(scales) == 3
    for scale in scales:
        CaptureSource.model_validate({"kind": "capture", "path": "x", "scale": yaml.safe_load(scale)})


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.yaml")), ids=lambda path: path.name)
def test_examples_are_specifications(path: Path) -> None:
    ScanSpec.model_validate(yaml.safe_load(path.read_text()))
