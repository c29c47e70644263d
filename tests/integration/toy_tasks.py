"""Steps that burn a little time and write small files, with ways to make them fail.

The plant's `treatment` says what goes wrong, as `KIND:FRAME:WHAT` separated by spaces, for instance
`frame.train:1:invalid`. WHAT is `invalid` (a permanent error), `broken` (an error every time), `die` (the process
kills itself) or `slow` (takes a minute). `die_once=FILE` and `slow_once=FILE` do so only the first time, which FILE
remembers; `invalid_until=FILE` does so until FILE is there. `memory` asks for more memory than there is. `takes=S`
computes for S seconds, and `chain=S` computes a chain of digests for S seconds that is saved on its way as a training
is, and ends in the same digest however often it is interrupted.
"""

import hashlib
import json
import os
import signal
import time
from pathlib import Path

from nerfmodal.errors import InvalidInput
from nerfmodal.progress import Progress, Report
from scanjobs.messages import EXTRACT, IDENTIFY, INSPECT, READ, RENDER, TRAIN

from services.worker.job import Job, Produced, StepStopped
from services.worker.protocol import Made

ROLES = {RENDER: "frame", READ: "frame", TRAIN: "checkpoint", EXTRACT: "cloud", IDENTIFY: "result.npz"}
SECONDS = float(os.environ.get("TOY_SECONDS", "0.05"))
FRAMES_OF_A_CAPTURE = 2


def toy(job: Job, report: Report) -> Produced:
    """Read all inputs, take a while, write one file that depends on them."""
    facts: dict[str, object] = {"pid": os.getpid(), "gpu": os.environ.get("CUDA_VISIBLE_DEVICES")}
    _go_wrong(job, report)
    chained = _chain(job, report, facts)
    _burn(SECONDS, report)
    if job.kind == INSPECT:
        return Produced(files=(), facts={"frames": FRAMES_OF_A_CAPTURE})
    digest = hashlib.sha256(f"{job.spec.seed} {job.kind} {job.frame} {chained}".encode())
    if job.kind == IDENTIFY:
        facts["clouds"] = [one.frame for one in job.files("cloud")]
    for one in job.inputs:
        assert one.role != "truth"
        digest.update(one.path.read_bytes())
    path = job.out / f"{job.kind}-{job.frame}.txt"
    path.write_text(f"{job.kind} {job.frame} {len(job.inputs)} {digest.hexdigest()}\n")
    print("a library that prints to stdout")  # must not reach the supervisor
    files = [Made(ROLES[job.kind], path)]
    if job.kind == RENDER and job.frame == 0:
        truth = job.out / "truth.npz"
        truth.write_text("what was imposed\n")
        files.append(Made("truth", truth))
    return Produced(files=tuple(files), facts=facts)


def _burn(seconds: float, report: Report) -> None:
    total = max(1, round(seconds / 0.01))
    for done in range(total):
        end = time.monotonic() + seconds / total
        while time.monotonic() < end:
            hashlib.sha256(b"x" * 1000).digest()
        report(Progress(done=done + 1, total=total))


def _go_wrong(job: Job, report: Report) -> None:
    for what in _plans(job):
        _fail_as(what, report)


def _plans(job: Job) -> list[str]:
    plans = (job.spec.plant.treatment or "").split() if job.spec.plant else []
    parts = [plan.split(":", 2) for plan in plans]
    return [what for kind, frame, what in parts if (kind, int(frame)) == (job.kind, job.frame)]


def _chain(job: Job, report: Report, facts: dict[str, object]) -> str:
    """A training in small: the last digest of a chain, whose links cost 10 ms each."""
    seconds = next((float(what.partition("=")[2]) for what in _plans(job) if what.startswith("chain=")), None)
    if seconds is None:
        return ""
    links = max(1, round(seconds / 0.01))
    done, digest = json.loads(job.resume.read_text()) if job.resume else (0, "")
    facts["taken_up_at"], saved_at = done, time.monotonic()
    try:
        while done < links:
            time.sleep(0.01)
            done, digest = done + 1, hashlib.sha256(f"{digest} {done}".encode()).hexdigest()
            if time.monotonic() - saved_at >= job.save_every_s:
                _save(job, done, digest)
                saved_at = time.monotonic()
            report(Progress(done=done, total=links))
    except StepStopped:
        _save(job, done, digest)
        raise
    return digest


def _save(job: Job, done: int, digest: str) -> None:
    path = job.out / f"saved-{done}"
    path.write_text(json.dumps([done, digest]))
    job.save(path)


def _fail_as(what: str, report: Report) -> None:
    name, _, mark = what.partition("=")
    if name == "invalid" or (name == "invalid_until" and not Path(mark).exists()):
        raise InvalidInput("the toy is broken.", where="/source", hint="Mend the toy.")
    if name == "broken":
        raise RuntimeError("the toy fails every time")
    if name == "memory":
        raise MemoryError
    if name == "takes":
        _burn(float(mark), report)
    if name == "die" or (name == "die_once" and _is_first(mark)):
        os.kill(os.getpid(), signal.SIGKILL)
    if name == "slow" or (name == "slow_once" and _is_first(mark)):
        _burn(60.0, report)


def _is_first(mark: str) -> bool:
    try:
        Path(mark).touch(exist_ok=False)
    except FileExistsError:
        return False
    return True


TASKS = dict.fromkeys((INSPECT, RENDER, READ, TRAIN, EXTRACT, IDENTIFY), toy)
