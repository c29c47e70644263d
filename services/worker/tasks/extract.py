"""`frame.extract`: the point cloud of a trained frame."""

from nerfmodal import io, pipeline
from nerfmodal.progress import Report

from services.worker.job import Job, Produced
from services.worker.protocol import Made


def extract_frame(job: Job, report: Report) -> Produced:
    """`cloud_0000.ply`."""
    checkpoint = io.read_checkpoint(job.needed("checkpoint", job.frame))
    frame = io.read_frame(job.needed("frame", job.frame))
    cloud = pipeline.extract(job.spec, checkpoint, frame, report=report)
    path = job.out / f"cloud_{job.frame:04d}.ply"
    io.write_cloud(path, cloud)
    return Produced(files=(Made("cloud", path),), facts={"points": len(cloud.points), "outcome": cloud.outcome.name})
