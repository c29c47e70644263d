"""`scan.identify`: all clouds become modes and everything that a user downloads. It is never given the truth."""

from collections.abc import Sequence

from nerfmodal import io, pipeline
from nerfmodal.progress import Report
from nerfmodal.spec import CloudsSource
from nerfmodal.types import PointCloud

from services.worker.job import Job, Produced
from services.worker.protocol import Made


def identify_scan(job: Job, report: Report) -> Produced:
    """Every file of `pipeline.publish`, under its path relative to the output folder."""
    clouds = _clouds(job)
    result = pipeline.identify(job.spec, clouds, report=report)
    path = job.file("frame", 0)
    frame = None if path is None else io.read_frame(path)
    files = pipeline.publish(job.spec, result, frame, next((one for one in clouds if one is not None), None), job.out)
    return Produced(files=tuple(Made(path.relative_to(job.out).as_posix(), path) for path in files))


def _clouds(job: Job) -> Sequence[PointCloud | None]:
    """By frame; None where a frame was lost."""
    if isinstance(job.spec.source, CloudsSource):
        return tuple(pipeline.read_clouds(job.spec))
    given = {one.frame: one.path for one in job.files("cloud")}
    return tuple(io.read_cloud(given[k]) if k in given else None for k in range(len(pipeline.frame_times(job.spec))))
