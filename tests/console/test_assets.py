"""The page's files: what was vendored is what was pinned, and each is sent to be kept, packed and under a policy."""

import gzip
import hashlib
import json
import re
from pathlib import Path

import pytest
from nerfmodal.types import Reason
from starlette.testclient import TestClient

from services.api.console.assets import FOLDER, accepts_gzip, library
from services.api.console.imports import of_pages, of_shell
from services.api.routes.console import POLICY
from tests.unit.api.service import Service

VENDORED = json.loads((FOLDER / "vendor/vendor.json").read_text())
SCRIPTS = sorted(path for path in FOLDER.rglob("*.js") if "vendor" not in path.parts)
LONGEST_FILE = 400


@pytest.fixture
def http(service: Service) -> TestClient:
    return service.http


def asset(name: str) -> str:
    return f"/console/{library().version}/{name}"


@pytest.mark.parametrize("row", VENDORED, ids=lambda row: row["file"])
def test_vendored_files_are_those_that_were_pinned(row: dict[str, str]):
    content = (FOLDER / "vendor" / row["file"]).read_bytes()
    assert hashlib.sha256(content).hexdigest() == row["sha256"]


def test_every_vendored_file_is_listed_and_comes_with_a_licence():
    there = {path.name for path in (FOLDER / "vendor").iterdir()} - {"vendor.json"}
    assert there == {row["file"] for row in VENDORED}
    licensed = {row["package"] for row in VENDORED if row["file"].endswith(".LICENSE")}
    assert licensed == {row["package"] for row in VENDORED}


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.relative_to(FOLDER).as_posix())
def test_scripts_are_short_say_what_they_are_and_import_what_exists(path: Path):
    text = path.read_text()
    assert text.startswith("/**")
    assert len(text.splitlines()) <= LONGEST_FILE
    named = re.findall(r"(?:from|import\()\s*\"(\.[^\"]+)\"", text)
    assert [name for name in named if not (path.parent / name).is_file()] == []


def test_the_page_names_files_that_exist_and_no_other_host(http: TestClient):
    text = http.get("/").text
    files = re.findall(r'(?:href|src)="([^"]+)"', text)
    assert files
    assert all(http.get(name).status_code == 200 for name in files)
    assert "//" not in "".join(files)
    assert "<script>" not in text


def test_the_files_that_a_page_needs_are_found_through_all_imports_and_the_shell_s_are_not_told_twice():
    contents = {
        "app/main.js": b'import { a } from "./a.js";\n',
        "app/a.js": b"export const a = 1;",
        "pages/one.js": b'import {\n  x,\n} from "../parts/x.js";\nconst later = () => import("./two.js");\n',
        "pages/two.js": b'import{a}from"../app/a.js";export{x}from"../parts/x.js";',
        "parts/x.js": b'import { one } from "../pages/one.js"; // a circle\n',
    }
    assert of_shell(contents) == ["app/a.js", "app/main.js"]
    both = ["pages/one.js", "parts/x.js"]
    assert of_pages(contents) == {"one": both, "two": ["pages/one.js", "pages/two.js", "parts/x.js"]}


def test_the_page_says_what_each_of_its_pages_imports_and_a_table_of_modes_waits_for_nothing_large(http: TestClient):
    text = http.get("/").text
    told = json.loads(text.split('id="imports">')[1].split("</script>")[0])
    assert set(told) == {path.stem for path in (FOLDER / "pages").iterdir()}
    assert all(name in library().files for names in told.values() for name in names)
    assert not [name for name in told["scan"] if "three" in name]
    assert {"vendor/uplot.js", "parts/chart.js", "pages/plant.js"} <= set(told["plant"])


def test_a_file_is_kept_for_good_under_its_version_and_asked_for_under_another(http: TestClient):
    now, before = http.get(asset("app/main.js")), http.get("/console/0123/app/main.js")
    assert now.headers["Cache-Control"] == "public, max-age=31536000, immutable"
    assert before.headers["Cache-Control"] == http.get("/").headers["Cache-Control"] == "no-cache"
    assert now.content == before.content


@pytest.mark.parametrize("path", ["/", "app/main.js", "vendor/three.core.min.js"])
def test_what_is_known_already_is_not_sent_again(http: TestClient, path: str):
    where = path if path == "/" else asset(path)
    etag = http.get(where).headers["ETag"]
    again = http.get(where, headers={"If-None-Match": etag})
    assert (again.status_code, again.content, again.headers["ETag"]) == (304, b"", etag)
    assert http.get(where, headers={"If-None-Match": '"other"'}).status_code == 200


def test_large_text_goes_packed_to_whom_takes_it(http: TestClient):
    name = "vendor/three.core.min.js"
    with http.stream("GET", asset(name)) as packed:
        raw = b"".join(packed.iter_raw())
    plain = http.get(asset(name), headers={"Accept-Encoding": "identity"})
    assert gzip.decompress(raw) == plain.content
    assert len(raw) < 0.4 * len(plain.content)
    assert packed.headers["ETag"] != plain.headers["ETag"]
    assert packed.headers["Vary"] == "Accept-Encoding"


@pytest.mark.parametrize(
    ("header", "takes"),
    [("gzip, deflate, br", True), ("*", True), ("gzip;q=0", False), ("br, gzip ; q=0.0", False), ("", False)],
)
def test_the_weights_of_encodings_are_read(header: str, takes: bool):
    assert accepts_gzip(header) is takes


def test_the_policy_lets_nothing_in_from_elsewhere(http: TestClient):
    assert http.get("/").headers["Content-Security-Policy"] == POLICY
    assert "unsafe" not in POLICY
    assert http.get("/").headers["X-Frame-Options"] == "DENY"


def test_every_reason_is_explained_in_the_service_s_words(http: TestClient):
    assert http.get(asset("words.json")).json()["reasons"] == {one.name: one.value for one in Reason}


def test_an_unknown_file_is_a_problem(http: TestClient):
    answer = http.get(asset("nothing.js"))
    assert (answer.status_code, answer.json()["code"]) == (404, "NOT_FOUND")
    assert http.get(asset("../app.py")).status_code == 404
