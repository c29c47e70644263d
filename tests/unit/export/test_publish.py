"""What is published is complete, described by its manifest and can be read back."""

import hashlib
import json
from pathlib import Path

import pytest
from nerfmodal.export import publish, write_manifest
from nerfmodal.io import read_result
from nerfmodal.spec import ScanSpec

from tests.fixtures.scans import small_cloud, small_frame, small_result, small_spec


@pytest.fixture(scope="module")
def published(tmp_path_factory) -> tuple[Path, tuple[Path, ...]]:
    out = tmp_path_factory.mktemp("published")
    (out / "figures").mkdir()
    picture = out / "figures" / "cloud.png"
    picture.write_bytes(b"\x89PNG not really")
    return out, publish(small_spec(), small_result(), small_frame(), small_cloud(), out, pictures=(picture,))


def test_all_files_are_returned_and_nothing_else_lies_there(published):
    out, files = published
    assert len(set(files)) == len(files)
    assert set(files) == {path for path in out.rglob("*") if path.is_file()}


def test_manifest_describes_every_other_file(published):
    out, files = published
    entries = json.loads((out / "manifest.json").read_text())["files"]
    assert {entry["path"] for entry in entries} == {
        path.relative_to(out).as_posix() for path in files if path.name != "manifest.json"
    }
    for entry in entries:
        content = (out / entry["path"]).read_bytes()
        assert entry["sha256"] == hashlib.sha256(content).hexdigest()
        assert entry["bytes"] == len(content)


def test_media_types_are_known(published):
    out, _ = published
    kinds = {entry["path"]: entry["media_type"] for entry in json.loads((out / "manifest.json").read_text())["files"]}
    assert kinds["report.html"] == "text/html"
    assert kinds["modes.json"] == "application/json"
    assert kinds["figures/cloud.png"] == "image/png"


def test_specification_beside_the_result_is_the_one_that_was_run(published):
    out, _ = published
    assert ScanSpec.model_validate_json((out / "spec.json").read_text()) == small_spec()


def test_result_reads_back(published):
    out, _ = published
    assert [organ.organ for organ in read_result(out / "result.npz").organs] == ["leaf_0", "trunk"]


def test_a_failed_write_leaves_the_old_manifest(published):
    out, _ = published
    before = (out / "manifest.json").read_bytes()
    with pytest.raises(FileNotFoundError):
        write_manifest([out / "missing.bin"], out)
    assert (out / "manifest.json").read_bytes() == before
