"""A line of the log is one JSON object with the ids it is about, and holds no secret, whoever logs it."""

import json
import logging
import threading
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st
from scanjobs.logs import about, configure, without_secrets
from scanjobs.settings import Settings


@pytest.fixture
def logging_as_json() -> Iterator[None]:
    """The root logger as a process of the service has it; as it was, afterwards."""
    root = logging.getLogger()
    before = root.handlers, root.level
    yield
    root.handlers, level = before
    root.setLevel(level)


def lines(capsys: pytest.CaptureFixture[str]) -> list[dict[str, object]]:
    return [json.loads(line) for line in capsys.readouterr().err.splitlines()]


@pytest.mark.usefixtures("logging_as_json")
def test_lines_are_json_with_the_ids_they_are_about(capsys: pytest.CaptureFixture[str]) -> None:
    configure(Settings(log_format="json"))
    log = logging.getLogger("some.module")
    with about(scan_id="s1", step_id="t1"):
        log.warning("lost %s of %s", 1, 2, extra={"duration_s": 0.5})
    log.info("after")
    log.debug("not asked for")
    first, second = lines(capsys)
    assert first | {"timestamp": ""} == {
        "event": "lost 1 of 2",
        "level": "warning",
        "logger": "some.module",
        "scan_id": "s1",
        "step_id": "t1",
        "duration_s": 0.5,
        "timestamp": "",
    }
    assert str(first["timestamp"]).endswith("Z")
    assert "scan_id" not in second


@pytest.mark.usefixtures("logging_as_json")
def test_threads_log_about_their_own_steps(capsys: pytest.CaptureFixture[str]) -> None:
    configure(Settings(log_format="json"))
    barrier = threading.Barrier(4)

    def work(number: int) -> None:
        with about(step_id=number):
            barrier.wait()
            logging.getLogger("x").info("%s", number)

    threads = [threading.Thread(target=work, args=(number,)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(line["event"] == str(line["step_id"]) for line in lines(capsys))


@pytest.mark.usefixtures("logging_as_json")
def test_exceptions_are_one_line_without_the_password(capsys: pytest.CaptureFixture[str]) -> None:
    configure(Settings(log_format="json"))
    try:
        raise ConnectionError("no route to postgresql+psycopg://nerfmodal:geheim@db/nerfmodal")
    except ConnectionError:
        logging.getLogger("x").exception("the database is away")
    [line] = lines(capsys)
    assert "ConnectionError" in str(line["exception"])
    assert "geheim" not in json.dumps(line)
    assert "***@db/nerfmodal" in str(line["exception"])


@given(st.text(st.characters(categories=("L", "N")), min_size=8, max_size=40))
def test_keys_and_passwords_are_struck_out_of_any_text(secret: str) -> None:
    assert secret not in without_secrets(f"redis://user:{secret}@host:6379/0 refused")
    if secret.isascii():
        assert secret not in without_secrets(f"Authorization: Bearer nm_{secret} was revoked")
        assert secret not in without_secrets(f"signed with whsec_{secret}")


def test_what_is_no_secret_stays() -> None:
    text = "the password is wrong in step 0198 of scan 0197 took 3 s; see http://localhost:8000/v1/scans and mail a@b.c"
    assert without_secrets(text) == text


@pytest.mark.usefixtures("logging_as_json")
def test_text_is_for_people(capsys: pytest.CaptureFixture[str]) -> None:
    configure(Settings(log_format="text", log_level="warning"))
    with about(scan_id="s1"):
        logging.getLogger("x").info("hidden")
        logging.getLogger("x").warning("shown")
    [line] = capsys.readouterr().err.splitlines()
    assert "shown" in line
    assert "scan_id=s1" in line
