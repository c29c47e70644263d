"""POST /v1/preflight: the body of a submission, answered without storing anything; times from past steps."""

from scanjobs.messages import TRAIN
from scanjobs.states import ScanState, StepState

from tests.unit.api.service import Service, simulation


def test_it_answers_and_stores_nothing(service: Service) -> None:
    answer = service.http.post("/v1/preflight", json=simulation())
    assert answer.status_code == 200
    body = answer.json()
    assert body["verdict"] == "refuse"
    assert body["findings"][0]["code"] == "TOO_FEW_FRAMES"
    assert body["findings"][0]["pointer"] == "/source/frames"
    assert body["record"]["frames"] == 3
    assert service.rows() == 0


def test_what_is_no_specification_is_refused_as_a_submission_is(service: Service) -> None:
    answer = service.http.post("/v1/preflight", json=simulation(nam="x"))
    assert (answer.status_code, answer.json()["code"], answer.json()["pointer"]) == (422, "INVALID_SPEC", "/nam")


def test_expected_modes_come_with_the_question(service: Service) -> None:
    spec = simulation()
    spec["source"]["frames"] = 90
    answer = service.http.post("/v1/preflight", params={"mode": "4.8:0.01:12"}, json=spec)
    assert answer.json()["modes"][-1]["frequency_hz"] == 4.8
    wrong = service.http.post("/v1/preflight", params={"mode": "4.8"}, json=simulation())
    assert (wrong.status_code, wrong.json()["code"]) == (422, "INVALID_PARAMETER")


def test_times_are_those_of_past_steps(service: Service) -> None:
    scan = service.submit()["id"]
    for frame in range(3):
        service.move_step(scan, TRAIN, frame, state=StepState.SUCCEEDED, started_at=100.0, finished_at=107.0)
    service.move(scan, state=ScanState.SUCCEEDED)
    steps = service.http.post("/v1/preflight", json=simulation()).json()["cost"]["steps"]
    [train] = [step for step in steps if step["step"] == TRAIN]
    assert (train["basis"], train["seconds_each"], train["count"]) == ("history", 7.0, 3)
    assert {step["basis"] for step in steps if step["step"] != TRAIN} == {"reference"}
