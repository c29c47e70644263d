"""`scan.inspect`: look at a capture or clouds before anything runs, and count the frames."""

from nerfmodal import pipeline
from nerfmodal.progress import Report
from nerfmodal.spec import CloudsSource

from services.worker.job import Job, Produced


def inspect_source(job: Job, report: Report) -> Produced:  # noqa: ARG001
    """No file; the fact `frames`. Raises `InvalidCapture`, `InvalidClouds` or `MissingExtra`."""
    pipeline.check_source(job.spec)
    if isinstance(job.spec.source, CloudsSource):
        return Produced(files=(), facts={"frames": 0})
    return Produced(files=(), facts={"frames": len(pipeline.frame_times(job.spec))})
