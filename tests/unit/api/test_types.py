"""A body is what its schema says: truths, numbers and dates do not stand for one another (found by the fuzzer).

Seen to fail: with the lax types of before (`bool`, `float`, `AwareDatetime` alone) every one of these was accepted.
"""

from typing import Any

import pytest

from services.api.schemas_access import Rotation
from services.api.schemas_alarms import AlarmChange
from services.api.schemas_environment import EnvironmentRecord
from services.api.schemas_plants import Monitoring, Reference
from services.api.schemas_schedules import ScheduleChange
from services.api.schemas_webhooks import WebhookChange
from tests.unit.api.service import Service, simulation

AT = "2026-01-01T00:00:00Z"
LAX: list[tuple[type[Any], dict[str, Any]]] = [
    (Rotation, {"grace_s": True}),
    (AlarmChange, {"new_reference": 0}),
    (EnvironmentRecord, {"at": AT, "values": {"a": False}}),
    (EnvironmentRecord, {"at": AT, "temperature_c": "20"}),
    (EnvironmentRecord, {"at": 0}),
    (EnvironmentRecord, {"at": "0"}),
    (Monitoring, {"growth": 1}),
    (Monitoring, {"false_alarms_per_year": True}),
    (Reference, {"until": 1_767_225_600}),
    (ScheduleChange, {"enabled": 1}),
    (ScheduleChange, {"grace_minutes": False}),
    (WebhookChange, {"enabled": 0}),
]


@pytest.mark.parametrize(("model", "body"), LAX, ids=[f"{model.__name__} {body}" for model, body in LAX])
def test_one_type_does_not_stand_for_another(model: type[Any], body: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match="Input should be"):
        model.model_validate(body)


def test_whole_numbers_and_dates_with_any_offset_are_taken() -> None:
    record = EnvironmentRecord.model_validate({"at": "2026-01-01T01:00:00+01:00", "mass_g": 12, "values": {"a": 3}})
    assert (record.at.timestamp(), record.mass_g, record.values) == (1_767_225_600, 12.0, {"a": 3.0})


def test_a_rate_without_a_duration_is_refused(service: Service) -> None:
    """Seen to fail: with `gt=0` a rate of 5e-324 Hz was a record of infinite seconds, which the answer said as null."""
    spec = simulation()
    spec["source"]["frame_rate_hz"] = 5e-324
    refused = service.http.post("/v1/preflight", json=spec)
    assert (refused.status_code, refused.json()["pointer"]) == (422, "/source/frame_rate_hz")
