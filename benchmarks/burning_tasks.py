"""Steps that burn the processor seconds of a small real scan, on one thread each. For `benchmarks.service`."""

import hashlib
import time

from nerfmodal.progress import Report
from scanjobs.messages import EXTRACT, IDENTIFY, RENDER, TRAIN

from benchmarks.empty_tasks import nothing
from services.worker.job import Job, Produced

SECONDS = {RENDER: 0.8, TRAIN: 1.2, EXTRACT: 0.4, IDENTIFY: 0.3}
"""In the proportions of `nerfmodal presets quick`, shortened."""


def burn(job: Job, report: Report) -> Produced:
    """Compute for as long as the step's kind takes, by the processor's clock, not the wall's."""
    end = time.process_time() + SECONDS[job.kind]
    while time.process_time() < end:
        hashlib.sha256(b"x" * 10_000).digest()
    return nothing(job, report)


TASKS = dict.fromkeys(SECONDS, burn)
