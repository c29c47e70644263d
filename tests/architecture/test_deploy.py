"""What deploy/ and docker-compose.yml say fits together, and what the service says of itself.

Held to the schemas of Compose and Kubernetes, to the metrics that a process really tells, and to one another.
"""

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import kubernetes_validate
import promql_parser
import pytest
import yaml
from packaging.requirements import Requirement
from prometheus_client.parser import text_string_to_metric_families
from scanjobs.messages import QUEUES
from scanjobs.settings import Settings
from scanjobs.store import open_store
from scanjobs.tables import Base
from scanjobs.telemetry import COUNTERS, HISTOGRAMS, Telemetry

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
COMPOSE = yaml.safe_load((ROOT / "docker-compose.yml").read_text())
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
OURS = {name: service for name, service in SERVICES.items() if "build" in service}
WORKERS = {name: service for name, service in OURS.items() if name.startswith("worker-")}
DOCKERFILES = sorted(DEPLOY.glob("Dockerfile.*"))
RULES = yaml.safe_load((DEPLOY / "prometheus/alerts.yml").read_text())["groups"][0]["rules"]
DASHBOARD = json.loads((DEPLOY / "grafana/dashboards/nerfmodal.json").read_text())
MANIFESTS = sorted((DEPLOY / "kubernetes").glob("*.yaml"))
CUSTOM = {"ScaledObject"}
"""Kinds that Kubernetes does not know by itself."""
KUBERNETES = "1.32"


def objects() -> Iterator[tuple[str, dict[str, Any]]]:
    for path in MANIFESTS:
        for document in yaml.safe_load_all(path.read_text()):
            if path.name != "kustomization.yaml":
                yield f"{path.name}:{document['kind']}/{document['metadata']['name']}", document


OBJECTS = dict(objects())
PODS = {name: one for name, one in OBJECTS.items() if one["kind"] in {"Deployment", "Job", "CronJob"}}


def expressions() -> Iterator[tuple[str, str]]:
    for rule in RULES:
        yield rule["alert"], rule["expr"]
    for panel in DASHBOARD["panels"]:
        for target in panel["targets"]:
            yield f"{panel['title']} {target['refId']}", target["expr"]
    for name, one in OBJECTS.items():
        for trigger in one.get("spec", {}).get("triggers", []) if one["kind"] == "ScaledObject" else []:
            yield name, trigger["metadata"]["query"]


EXPRESSIONS = dict(expressions())


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """Every series that a process tells, with the labels it may have; Prometheus adds where it comes from."""
    settings = Settings(data_folder=tmp_path_factory.mktemp("told"))
    store = open_store(settings.database)
    Base.metadata.create_all(store.engine)
    telemetry = Telemetry(settings, store)
    telemetry.http.labels("GET", "/", "200").observe(0.1)
    telemetry.exposition()  # asks the database, which is then told of as timed
    text, _ = telemetry.exposition()
    store.close()
    found = {
        sample.name: set(sample.labels)
        for family in text_string_to_metric_families(text.decode())
        for sample in family.samples
    }
    found |= {f"nerfmodal_{name}_total": set(labels) for name, (_, labels) in COUNTERS.items()}
    for name, (_, labels, _) in HISTOGRAMS.items():
        found |= {f"nerfmodal_{name}_{end}": {*labels, "le"} for end in ("bucket", "sum", "count")}
    return found | {"up": set()}


def test_compose_file_fits_the_schema_of_compose():
    command = [
        sys.executable,
        "-m",
        "check_jsonschema",
        "--builtin-schema",
        "vendor.compose-spec",
        "docker-compose.yml",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_compose_starts_everything_that_is_needed():
    needed = {"postgres", "redis", "objects", "migrate", "api", "worker-render", "worker-train", "worker-identify"}
    assert set(SERVICES) >= needed | {"prometheus", "grafana"}
    waited_for = {other for service in SERVICES.values() for other in service.get("depends_on", {})}
    assert waited_for <= set(SERVICES)
    volumes = {str(entry).split(":")[0] for service in SERVICES.values() for entry in service.get("volumes", [])}
    assert {volume for volume in volumes if not volume.startswith(".")} == set(COMPOSE["volumes"])


def test_every_queue_has_a_worker_but_the_one_that_needs_a_gpu():
    served = {queue for one in WORKERS.values() for queue in one["command"][-1].split(",")}
    assert served == set(QUEUES) - {"train-gpu"}


def test_every_variable_of_the_service_is_a_setting():
    """A misspelt one would be ignored in silence."""
    known = {f"NERFMODAL_{name.upper()}" for name in Settings.model_fields}
    given = {name for one in OURS.values() for name in one["environment"] if name.startswith("NERFMODAL_")}
    config = next(
        one for one in OBJECTS.values() if one["kind"] == "ConfigMap" and one["metadata"]["name"] == "nerfmodal"
    )
    given |= {name for name in config["data"] if name.startswith("NERFMODAL_")}
    assert given <= known


def test_images_are_pinned_and_name_no_registry():
    used = [service["image"] for service in SERVICES.values() if "image" in service]
    used += [
        line.split()[1] for path in DOCKERFILES for line in path.read_text().splitlines() if line.startswith("FROM")
    ]
    for image in used:
        name, _, tag = image.partition(":")
        assert re.search(r"\d+\.\d+|\d{4}-\d{2}", tag), f"{image} may be another one tomorrow"
        assert "." not in name.split("/")[0], f"{image} names a host"


@pytest.mark.parametrize("path", DOCKERFILES, ids=lambda path: path.suffix[1:])
def test_images_are_slim_pinned_and_run_as_nobody_in_particular(path: Path):
    lines = path.read_text().splitlines()
    users = [line.split()[1] for line in lines if line.startswith("USER")]
    assert users == ["10001"]
    assert "slim" in next(line for line in lines if line.startswith("FROM"))
    assert all("--constraint" in line for line in lines if "pip install" in line)
    copied = [part for line in lines if line.startswith("COPY") for part in line.split()[1:-1]]
    assert [part for part in copied if not (ROOT / part).exists()] == []
    assert ("Blender" in path.read_text()) == (path.suffix in {".worker-render", ".api"})
    assert ("simulate" in path.read_text()) == (path.suffix == ".worker-render")


def test_one_image_per_role():
    assert {path.suffix[1:] for path in DOCKERFILES} == {"api", "worker-cpu", "worker-gpu", "worker-render"}


def test_pinned_versions_are_those_that_the_package_asks_for():
    """An image that cannot be solved would be found on the day of the release."""
    document = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = document["optional-dependencies"]
    wanted = [Requirement(text) for text in document["dependencies"]]
    wanted += [
        Requirement(text) for extra in ("vision", "simulate", "postgres", "s3", "telemetry") for text in extras[extra]
    ]
    lines = [line for line in (DEPLOY / "constraints.txt").read_text().splitlines() if not line.startswith("#")]
    pinned = {name: version for name, _, version in (line.partition("==") for line in lines)}
    for one in wanted:
        name = re.sub(r"[-_.]+", "-", one.name).lower()
        assert pinned.get(name, "0") in one.specifier, f"{one}: run python deploy/pin.py"


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_expressions_ask_for_what_is_told(name: str, told: dict[str, set[str]]):
    expression = EXPRESSIONS[name]
    promql_parser.parse(expression)
    for metric, labels in selected(promql_parser.parse(expression)):
        assert metric in told, metric
        assert labels <= told[metric] | {"job", "instance"}, (metric, labels)


def selected(node: Any) -> Iterator[tuple[str, set[str]]]:
    """The series that an expression reads, with the labels it chooses by."""
    if isinstance(node, promql_parser.VectorSelector):
        yield node.name, {matcher.name for matcher in node.matchers.matchers}
    for part in ("expr", "lhs", "rhs", "vector_selector", "vs", "param"):
        inner = getattr(node, part, None)
        if inner is not None and not isinstance(inner, str | bool):
            yield from selected(inner)
    for argument in getattr(node, "args", None) or ():
        yield from selected(argument)


def test_looking_into_expressions_finds_what_is_there():
    found = dict(
        selected(promql_parser.parse('sum(rate(a_total{x="1"}[5m])) / max by (k) (b) > time() - c and absent(d)'))
    )
    assert found == {"a_total": {"x"}, "b": set(), "c": set(), "d": set()}


def test_every_alert_has_a_runbook_entry_and_no_entry_is_left_over():
    entries = re.findall(r"^## (\w+)$", (ROOT / "docs/howto/runbook.md").read_text(), flags=re.MULTILINE)
    assert entries == [rule["alert"] for rule in RULES]


def test_every_alert_says_how_urgent_it_is():
    assert {rule["labels"]["severity"] for rule in RULES} == {"page", "ticket"}
    assert all(rule["annotations"]["summary"] for rule in RULES)


def test_everything_that_the_issue_asks_to_be_told_is_on_the_dashboard(told: dict[str, set[str]]):
    """Queue depth, durations, rays, leases, retries, bytes; and no series of ours that nobody looks at."""
    shown = {metric for expression in EXPRESSIONS.values() for metric, _ in selected(promql_parser.parse(expression))}
    ends = ("_created", "_sum", "_count", "_bucket", "_info")
    ours = {name for name in told if name.startswith("nerfmodal_") and not name.endswith(ends)}
    assert ours - shown <= {"nerfmodal_overdue_leases", "nerfmodal_artifacts"}
    assert {"nerfmodal_step_seconds_bucket", "nerfmodal_dispatch_lag_seconds_bucket"} <= shown


@pytest.mark.parametrize("name", [name for name, one in OBJECTS.items() if one["kind"] not in CUSTOM])
def test_manifests_fit_the_schema_of_kubernetes(name: str):
    kubernetes_validate.validate(OBJECTS[name], KUBERNETES, strict=True)


@pytest.mark.parametrize("name", PODS)
def test_containers_are_limited_and_run_without_rights(name: str):
    spec = PODS[name]["spec"]
    pod = (spec["jobTemplate"]["spec"] if PODS[name]["kind"] == "CronJob" else spec)["template"]["spec"]
    assert pod["securityContext"]["runAsNonRoot"]
    for container in pod["containers"]:
        assert {"requests", "limits"} <= set(container["resources"])
        assert container["securityContext"]["allowPrivilegeEscalation"] is False
        assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}


@pytest.mark.parametrize("name", [name for name, one in PODS.items() if one["kind"] == "Deployment"])
def test_deployments_are_probed_and_end_in_good_order(name: str):
    pod = PODS[name]["spec"]["template"]["spec"]
    [container] = pod["containers"]
    assert container["livenessProbe"]["httpGet"]["path"] == "/healthz"
    assert container["readinessProbe"]["httpGet"]["path"] == "/readyz"
    assert pod["terminationGracePeriodSeconds"] > Settings().drain_s


def test_every_worker_scales_with_its_queues():
    """Each queue that somebody serves is in the query of who serves it."""
    workers = {one["metadata"]["name"]: one for one in PODS.values() if one["metadata"]["name"].startswith("worker-")}
    scaled = {one["spec"]["scaleTargetRef"]["name"]: one for one in OBJECTS.values() if one["kind"] == "ScaledObject"}
    assert set(scaled) == set(workers)
    for name, worker in workers.items():
        [container] = worker["spec"]["template"]["spec"]["containers"]
        queues = container["args"][-1].split(",")
        query = scaled[name]["spec"]["triggers"][0]["metadata"]["query"]
        assert set(re.search(r'queue=~"([^"]+)"', query)[1].split("|")) == set(queues)  # type: ignore[index]
    assert {
        queue
        for one in workers.values()
        for queue in one["spec"]["template"]["spec"]["containers"][0]["args"][-1].split(",")
    } == set(QUEUES)
    assert any(one["spec"]["minReplicaCount"] > 0 for one in scaled.values()), "somebody must plan and dispatch"


def test_kustomization_lists_every_manifest():
    listed = yaml.safe_load((DEPLOY / "kubernetes/kustomization.yaml").read_text())["resources"]
    assert sorted(listed) == [path.name for path in MANIFESTS if path.name != "kustomization.yaml"]
