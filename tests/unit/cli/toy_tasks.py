"""The real service with toy steps: identification publishes a small known result, and the truth is that result's own.

A scan tagged `broken` fails in its first step. What only some steps need is imported in them: each is a process.
"""

from pathlib import Path

from nerfmodal.errors import InvalidInput
from nerfmodal.pipeline import Progress, Report
from scanjobs.messages import EXTRACT, IDENTIFY, RENDER, TRAIN

from services.worker.job import Job, Produced
from services.worker.protocol import Made

ROLES = {RENDER: "frame", TRAIN: "checkpoint", EXTRACT: "cloud"}


def toy(job: Job, report: Report) -> Produced:
    report(Progress(done=1, total=1))
    if "broken" in job.spec.tags:
        raise InvalidInput("the toy is broken.", where="/tags", hint="Mend the toy.")
    path = job.out / f"{job.frame}.bin"
    path.write_text(f"{job.kind} {job.frame}")
    files = [Made(ROLES[job.kind], path)]
    if job.kind == RENDER and job.frame == 0:
        files.append(Made("truth", _truth(job.out / "truth.npz")))
    return Produced(files=tuple(files))


def identify(job: Job, report: Report) -> Produced:
    from nerfmodal import io
    from nerfmodal.export.modes import write_modes

    from tests.fixtures.scans import small_result

    report(Progress(done=1, total=1))
    io.write_result(job.out / "result.npz", small_result())
    files = (job.out / "result.npz", *write_modes(small_result(), job.spec, job.out))
    return Produced(files=tuple(Made(path.relative_to(job.out).as_posix(), path) for path in files))


def _truth(path: Path) -> Path:
    from nerfmodal import io
    from nerfmodal.identify.comparison import modes_as_truth

    from tests.fixtures.scans import small_result

    io.write_truth(path, [mode for organ in small_result().organs for mode in modes_as_truth(organ)])
    return path


TASKS = {RENDER: toy, TRAIN: toy, EXTRACT: toy, IDENTIFY: identify}
