"""`frame.render`: one frame of a simulation; frame 0 also writes down what was imposed."""

from nerfmodal import io, pipeline
from nerfmodal.progress import Report

from services.worker.job import Job, Produced
from services.worker.protocol import Made


def render_frame(job: Job, report: Report) -> Produced:
    """`frame_0000.zip`, and for frame 0 `truth.npz`, which identification never reads."""
    path = job.out / f"frame_{job.frame:04d}.zip"
    io.write_frame(path, pipeline.make_frame(job.spec, job.frame, report=report))
    files = [Made("frame", path)]
    if job.frame == 0:
        truth = job.out / "truth.npz"
        pipeline.write_truth(job.spec, truth)
        files.append(Made("truth", truth))
    return Produced(files=tuple(files))
