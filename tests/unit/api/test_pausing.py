"""Pausing and resuming scans and workers over HTTP; who may."""

from scanjobs import workers
from scanjobs.messages import QUEUES
from scanjobs.scopes import Scope
from scanjobs.uuids import new_id
from scanjobs.workers import WorkerIdentity

from tests.unit.api.service import Service


def hire(service: Service) -> str:
    """A worker that is alive; its id."""
    identity = WorkerIdentity(id=new_id(), host="here", pid=1, queues=QUEUES, slots=2)
    service.store.write(lambda session: workers.register(session, identity, 60.0))
    return identity.id


def test_a_scan_is_paused_and_goes_on(service: Service) -> None:
    scan_id = service.submit()["id"]
    paused = service.http.post(f"/v1/scans/{scan_id}/pause")
    assert (paused.status_code, paused.json()["state"], paused.json()["paused_for"]) == (202, "paused", "asked")
    assert service.http.post(f"/v1/scans/{scan_id}/pause").json()["state"] == "paused"
    resumed = service.http.post(f"/v1/scans/{scan_id}/resume")
    assert (resumed.status_code, resumed.json()["state"], resumed.json()["paused_for"]) == (202, "queued", None)
    assert service.http.post(f"/v1/scans/{scan_id}/resume").status_code == 202


def test_what_has_ended_is_neither_paused_nor_resumed(service: Service) -> None:
    scan_id = service.submit()["id"]
    service.http.post(f"/v1/scans/{scan_id}/cancel")
    for verb in ("pause", "resume"):
        refused = service.http.post(f"/v1/scans/{scan_id}/{verb}")
        assert (refused.status_code, refused.json()["code"]) == (409, "ILLEGAL_TRANSITION")


def test_a_worker_is_paused_resumed_and_drained(service: Service) -> None:
    name = hire(service)
    listed = service.http.get("/v1/workers").json()["items"]
    assert [(row["id"], row["state"], row["slots"]) for row in listed] == [(name, "active", 2)]
    states = [service.http.post(f"/v1/workers/{name}/{verb}").json()["state"] for verb in ("pause", "resume", "drain")]
    assert states == ["paused", "active", "draining"]
    assert service.http.post(f"/v1/workers/{name}/resume").json()["state"] == "draining"
    assert service.http.post(f"/v1/workers/{new_id()}/pause").status_code == 404
    assert service.http.post("/v1/workers/none/pause").status_code == 404


def test_workers_are_the_operators_alone(service: Service) -> None:
    """Guard: `operator_of`. Seen to fail: with the scope alone the other owner's `admin` drains everybody's worker."""
    name = hire(service)
    secrets = {
        (owner, scope): service.key(owner, Scope(scope))
        for owner, scope in (("other", "admin"), ("local", "submit"), ("local", "admin"))
    }
    with service.locked() as http:
        codes = {
            who: http.post(f"/v1/workers/{name}/drain", headers={"Authorization": f"Bearer {secret}"}).status_code
            for who, secret in secrets.items()
        }
    assert codes == {("other", "admin"): 403, ("local", "submit"): 403, ("local", "admin"): 202}
