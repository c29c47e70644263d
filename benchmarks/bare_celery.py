"""Celery as it comes, with an empty task: what a step of the service is compared with. For `benchmarks.service`."""

import os

from celery import Celery

app = Celery("bare", broker=os.environ["BARE_BROKER"], backend=os.environ["BARE_BROKER"])


@app.task(name="nothing")
def nothing(step_id: str) -> str:
    """What a step costs when there is neither work nor state."""
    return step_id
