"""`scan.inspect`: look at a capture or clouds before anything runs, and count the frames."""

from nerfmodal import pipeline
from nerfmodal.progress import Report
from nerfmodal.spec import CloudsSource

from services.worker.job import Job, Produced


def inspect_source(job: Job, report: Report) -> Produced:
    """No file; the fact `frames`, and how many pictures a capture lacks. What a capture does not say is found out here.

    Raises `InvalidCapture`, `InvalidClouds`, `InvalidSpec` or `MissingExtra`.
    """
    opened = pipeline.open_source(job.spec, report=report)
    pipeline.check_source(job.spec, opened, report=report)
    if isinstance(job.spec.source, CloudsSource):
        return Produced(files=(), facts={"frames": 0})
    facts = {"frames": len(pipeline.frame_times(job.spec, opened))}
    return Produced(files=(), facts=facts | ({} if opened is None else {"missing_pictures": len(opened.missing)}))
