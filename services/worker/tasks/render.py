"""`frame.render`: one frame of a simulation; frame 0 also writes the truth, each its depth maps if asked."""

from nerfmodal import io, pipeline
from nerfmodal.progress import Report

from services.worker.job import Job, Produced
from services.worker.protocol import Made


def render_frame(job: Job, report: Report) -> Produced:
    """`frame_0000.zip`; for frame 0 `truth.npz` and, if asked for, `depth_0000.npz`: no later step is given these."""
    path = job.out / f"frame_{job.frame:04d}.zip"
    io.write_frame(path, pipeline.make_frame(job.spec, job.frame, report=report))
    files = [Made("frame", path)]
    if job.frame == 0:
        truth = job.out / "truth.npz"
        pipeline.write_truth(job.spec, truth)
        files.append(Made("truth", truth))
    depths = job.out / f"depth_{job.frame:04d}.npz"
    if pipeline.write_depths(job.spec, job.frame, depths):
        files.append(Made("depth", depths))
    return Produced(files=tuple(files))
