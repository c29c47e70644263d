"""`scan.identify`: the modes from all clouds, and the files that the user downloads. It is never given the truth.

Of frame n instead of the whole scan: the modes so far, from the clouds before that frame, in a `modes.json` whose key
`partial` says so. The fact `lost_frames` names the frames that failed for good: the record has gaps there.
"""

from collections.abc import Sequence

from nerfmodal import io, pipeline
from nerfmodal.progress import Report
from nerfmodal.spec import CloudsSource
from nerfmodal.types import PointCloud
from scanjobs.plan import WHOLE_SCAN

from services.worker.job import Job, Produced
from services.worker.protocol import Made

SO_FAR = "so_far/modes.json"
"""Role of a partial result: no name of a result's file."""


def identify_scan(job: Job, report: Report) -> Produced:
    """Every file of `pipeline.publish`, under its path relative to the output folder."""
    if job.frame != WHOLE_SCAN:
        return _identify_so_far(job, report)
    clouds = _clouds(job)
    result = pipeline.identify(job.spec, clouds, report=report)
    path = job.file("frame", 0)
    frame = None if path is None else io.read_frame(path)
    files = pipeline.publish(job.spec, result, frame, next((one for one in clouds if one is not None), None), job.out)
    made = tuple(Made(path.relative_to(job.out).as_posix(), path) for path in files)
    return Produced(files=made, facts={"lost_frames": _lost(clouds)})


def _identify_so_far(job: Job, report: Report) -> Produced:
    clouds = _clouds(job)
    result = pipeline.identify(job.spec, clouds, report=report)
    facts = {"partial": True, "frames": job.frame, "lost_frames": _lost(clouds[: job.frame])}
    path = pipeline.publish_so_far(job.spec, result, job.frame, job.out)
    return Produced(files=(Made(SO_FAR, path),), facts=facts)


def _clouds(job: Job) -> Sequence[PointCloud | None]:
    """By frame; None where a frame was lost, or is not there yet."""
    if isinstance(job.spec.source, CloudsSource):
        return tuple(pipeline.read_clouds(job.spec))
    given = {one.frame: one.path for one in job.files("cloud")}
    return tuple(io.read_cloud(given[k]) if k in given else None for k in range(len(pipeline.frame_times(job.spec))))


def _lost(clouds: Sequence[PointCloud | None]) -> list[int]:
    return [k for k, cloud in enumerate(clouds) if cloud is None]
