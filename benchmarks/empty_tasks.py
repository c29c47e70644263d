"""Steps that compute nothing: each writes one small file that differs from every other. For `benchmarks.service`."""

from nerfmodal.progress import Report
from scanjobs.messages import EXTRACT, IDENTIFY, RENDER, TRAIN

from services.worker.job import Job, Produced
from services.worker.protocol import Made

ROLES = {RENDER: "frame", TRAIN: "checkpoint", EXTRACT: "cloud", IDENTIFY: "result.npz"}


def nothing(job: Job, report: Report) -> Produced:  # noqa: ARG001
    """What is left of a step when the science is taken out."""
    path = job.out / "out.txt"
    path.write_text(f"{job.spec.seed} {job.kind} {job.frame}")
    return Produced(files=(Made(ROLES[job.kind], path),))


TASKS = dict.fromkeys(ROLES, nothing)
