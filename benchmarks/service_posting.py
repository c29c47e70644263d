"""POST /v1/scans under 32 clients against an empty handler of the same app, turn by turn in one server."""

import itertools
import json
from collections.abc import Iterator

from benchmarks.http_load import request, serving, throughput
from benchmarks.rows import Row
from benchmarks.service_servers import Servers
from services.api.presets import PRESETS

CLIENTS = 32
ROUNDS = 4
ROUND_S = 3.0


def posting_rows(machine: Servers) -> Iterator[Row]:
    """Throughput of submissions over that of nothing; the sum of all rounds, so that no lucky one decides."""
    spec = json.loads(PRESETS["quick"].model_dump_json())
    bodies = (json.dumps(spec | {"seed": seed}).encode() for seed in itertools.count())
    empty = request("POST", "/v1/empty", json.dumps(spec).encode())
    with serving(_variables(machine)) as port:
        throughput(port, lambda: empty, clients=CLIENTS, seconds=0.5)
        posted = emptied = 0.0
        for _ in range(ROUNDS):
            emptied += throughput(port, lambda: empty, clients=CLIENTS, seconds=ROUND_S) / ROUNDS
            posted += (
                throughput(port, lambda: request("POST", "/v1/scans", next(bodies)), clients=CLIENTS, seconds=ROUND_S)
                / ROUNDS
            )
    what = f"POST /v1/scans ({posted:.0f}/s) over an empty handler ({emptied:.0f}/s)"
    yield Row(what=what, value=posted / emptied, unit="x", floor=0.25, aim=0.6)


def _variables(machine: Servers) -> dict[str, str]:
    return {
        "NERFMODAL_DATABASE_URL": machine.database("posting"),
        "NERFMODAL_BROKER_URL": machine.redis.url,
        "NERFMODAL_DATA_FOLDER": str(machine.folder / "posting"),
        "NERFMODAL_REQUESTS_PER_MINUTE": str(10**9),
        "NERFMODAL_KEYLESS": "true",
    }
