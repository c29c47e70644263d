"""`frame.read`: one frame of a capture, as every later step reads it."""

from nerfmodal import io, pipeline
from nerfmodal.progress import Report

from services.worker.job import Job, Produced
from services.worker.protocol import Made


def read_frame(job: Job, report: Report) -> Produced:
    """`frame_0000.zip`."""
    path = job.out / f"frame_{job.frame:04d}.zip"
    io.write_frame(path, pipeline.make_frame(job.spec, job.frame, report=report))
    return Produced(files=(Made("frame", path),))
