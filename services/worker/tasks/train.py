"""`frame.train`: frame 0 from nothing to the shared checkpoint, then every frame from that checkpoint."""

from nerfmodal import io, pipeline
from nerfmodal.progress import Report
from nerfmodal.types import Checkpoint
from scanjobs.plan import WHOLE_SCAN

from services.worker.job import Job, Produced
from services.worker.protocol import Made


def train_frame(job: Job, report: Report) -> Produced:
    """`checkpoint_first.safetensors` for the whole scan, `checkpoint_0000.safetensors` for a frame."""
    name = "first" if job.frame == WHOLE_SCAN else f"{job.frame:04d}"
    path = job.out / f"checkpoint_{name}.safetensors"
    checkpoint = _train(job, report)
    io.write_checkpoint(path, checkpoint)
    rays = checkpoint.step * job.spec.reconstruction.rays_per_batch
    facts = {
        "iterations": checkpoint.step,
        "rays": rays,
        "psnr": checkpoint.psnr,
        "held_out_psnr": checkpoint.held_out_psnr,
    }
    return Produced(files=(Made("checkpoint", path),), facts=facts)


def _train(job: Job, report: Report) -> Checkpoint:
    first = io.read_frame(job.needed("frame", 0))
    unfinished = job.out / "training.safetensors"
    resume = io.ResumeFile(unfinished, start=job.resume, kept=job.save, every_s=job.save_every_s)
    if job.frame == WHOLE_SCAN:
        return pipeline.fit_first(job.spec, first, report=report, resume=resume)
    parent = io.read_checkpoint(job.needed("checkpoint", WHOLE_SCAN))
    frame = first if job.frame == 0 else io.read_frame(job.needed("frame", job.frame))
    return pipeline.fine_tune(job.spec, parent, first, frame, report=report, resume=resume)
