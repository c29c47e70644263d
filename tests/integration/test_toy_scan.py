"""A scan of toy steps goes through SQLite, the in-memory broker and runner processes, end to end."""

from nerfmodal.spec import ScanSpec
from scanjobs import repository
from scanjobs.states import StepState

from tests.integration.toy_service import Service, toy_spec


def test_simulation_ends_with_every_step_done_once(service: Service) -> None:
    scan = service.end_of(service.submit(toy_spec(frames=3)))
    assert scan.state == "succeeded"
    with service.store.read() as session:
        steps = repository.list_steps(session, scan)
        files = repository.list_artifacts(session, scan)
    assert [step.state for step in steps] == [StepState.SUCCEEDED] * 11
    assert [step.token for step in steps] == [1] * 11
    assert sorted(file.role for file in files) == sorted(
        ["truth"] + ["frame"] * 3 + ["checkpoint"] * 4 + ["cloud"] * 3 + ["result.npz"]
    )


def test_capture_is_planned_after_it_was_inspected(service: Service) -> None:
    spec = ScanSpec.model_validate({"source": {"kind": "capture", "path": "/nowhere"}})
    scan = service.end_of(service.submit(spec))
    assert (scan.state, scan.frames) == ("succeeded", 2)
    with service.store.read() as session:
        kinds = [(one.kind, one.done, one.total) for one in repository.step_summaries(session, scan)]
    assert kinds == [
        ("scan.inspect", 1, 1),
        ("frame.read", 2, 2),
        ("frame.train", 3, 3),
        ("frame.extract", 2, 2),
        ("scan.identify", 1, 1),
    ]


def test_clouds_are_only_inspected_and_identified(service: Service) -> None:
    spec = ScanSpec.model_validate({"source": {"kind": "clouds", "path": "/nowhere"}})
    scan = service.end_of(service.submit(spec))
    assert scan.state == "succeeded"
    with service.store.read() as session:
        assert [step.kind for step in repository.list_steps(session, scan)] == ["scan.inspect", "scan.identify"]
