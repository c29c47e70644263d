"""Train nerfstudio's nerfacto on the CPU and print its held-out PSNR as JSON lines; runs in nerfstudio's environment.

    PYTHON benchmarks/nerfacto_runner.py FOLDER --seconds 300 --threads 1 [--state FILE]

`FOLDER` is what `benchmarks.nerfacto` writes: a transforms.json, its pictures, and held_out.npy (view, row, column of
the pixels that are compared, views counted among `val_filenames`). A line is {"seconds", "steps", "rays", "psnr"}:
CPU seconds spent on training alone (reading, building the model and evaluating are left out), and the PSNR of
colours in [0, 1]. With `--state` the training goes on where an earlier run stopped, and stops where a later may go on.

Everything is nerfstudio's default for `ns-train nerfacto --machine.device-type cpu
--pipeline.model.implementation torch`, trained by its own `Trainer`, but for: no viewer; rays drawn in this process,
not in a second one that would take a core; poses as they are in the file; no LPIPS, whose weights would be downloaded.
"""

import argparse
import importlib
import json
import time
from pathlib import Path

import numpy as np
import torch

FIRST, GROWTH = 5.0, 1.4
"""CPU seconds of training before the first evaluation, and how much later each further one comes."""
CHUNK = 1024
"""Rays evaluated at once."""


def import_torchvision() -> None:
    """Import torchvision even where its compiled part was built for another torch: nothing compiled is used."""
    try:
        importlib.import_module("torchvision")
    except RuntimeError:
        for operator in ("nms", "qnms"):
            torch.library.define(f"torchvision::{operator}", "(Tensor boxes, Tensor scores, float iou) -> Tensor")
        importlib.import_module("torchvision")


def trainer_of(folder: Path, rays: int):
    """Nerfstudio's own trainer of nerfacto on the capture in `folder`."""
    import torchmetrics.image.lpip

    torchmetrics.image.lpip.LearnedPerceptualImagePatchSimilarity = lambda **_: torch.nn.Identity()
    from nerfstudio.configs.method_configs import method_configs
    from nerfstudio.data.datamanagers.base_datamanager import VanillaDataManager, VanillaDataManagerConfig
    from nerfstudio.data.dataparsers.nerfstudio_dataparser import NerfstudioDataParserConfig
    from nerfstudio.data.datasets.base_dataset import InputDataset

    config = method_configs["nerfacto"]
    config.machine.device_type = "cpu"
    config.pipeline.model.implementation = "torch"
    config.vis = "tensorboard"
    config.output_dir = folder / "nerfstudio"
    config.data = folder
    config.set_timestamp()
    config.pipeline.datamanager = VanillaDataManagerConfig(
        _target=VanillaDataManager[InputDataset],
        dataparser=NerfstudioDataParserConfig(
            data=folder, downscale_factor=1, orientation_method="none", center_method="none", auto_scale_poses=False
        ),
        train_num_rays_per_batch=rays,
    )
    trainer = config.setup(local_rank=0, world_size=1)
    trainer.setup()
    return trainer


def step_once(trainer, step: int) -> None:
    """What `Trainer.train` does in one iteration, without its logging."""
    from nerfstudio.engine.callbacks import TrainingCallbackLocation

    trainer.pipeline.train()
    for callback in trainer.callbacks:
        callback.run_callback_at_location(step, location=TrainingCallbackLocation.BEFORE_TRAIN_ITERATION)
    trainer.train_iteration(step)
    for callback in trainer.callbacks:
        callback.run_callback_at_location(step, location=TrainingCallbackLocation.AFTER_TRAIN_ITERATION)


@torch.no_grad()
def held_out_psnr(trainer, pixels: torch.Tensor) -> float:
    """Peak signal-to-noise ratio, dB, of the held-out pixels."""
    pipeline, dataset = trainer.pipeline, trainer.pipeline.datamanager.eval_dataset
    sampler = pipeline.model.proposal_sampler
    since_update = sampler._steps_since_update  # rendering counts it anew: training must not notice
    pipeline.eval()
    truth = torch.stack([dataset.get_image_float32(view) for view in range(len(dataset))])
    squared = 0.0
    for chunk in pixels.split(CHUNK):
        view, row, column = chunk.unbind(1)
        rays = dataset.cameras.generate_rays(
            camera_indices=view[:, None], coords=torch.stack([row + 0.5, column + 0.5], dim=1)
        )
        shown = pipeline.model(rays)["rgb"].clamp(0, 1)
        squared += float(((shown - truth[view, row, column]) ** 2).sum())
    sampler._steps_since_update = since_update
    return float(-10 * np.log10(squared / (3 * len(pixels))))


def restored(trainer, path: Path | None) -> tuple[int, float]:
    """Steps and seconds that the state in `path` stands for, which is loaded."""
    if path is None or not path.exists():
        return 0, 0.0
    state = torch.load(path, weights_only=False)
    trainer.pipeline.load_state_dict(state["pipeline"])
    trainer.optimizers.load_optimizers(state["optimizers"])
    trainer.optimizers.load_schedulers(state["schedulers"])
    trainer.pipeline.model.proposal_sampler._steps_since_update = state["since_update"]
    return state["steps"], state["seconds"]


def keep(trainer, path: Path, steps: int, seconds: float) -> None:
    """Write what `restored` reads."""
    optimizers = trainer.optimizers
    torch.save(
        {
            "steps": steps,
            "seconds": seconds,
            "pipeline": trainer.pipeline.state_dict(),
            "optimizers": {name: one.state_dict() for name, one in optimizers.optimizers.items()},
            "schedulers": {name: one.state_dict() for name, one in optimizers.schedulers.items()},
            "since_update": trainer.pipeline.model.proposal_sampler._steps_since_update,
        },
        path,
    )


def train(trainer, seconds: float, pixels: torch.Tensor, state: Path | None) -> None:
    """Train until `seconds` of CPU time were spent on it in all; print a line at growing intervals and at the end."""
    steps, spent = restored(trainer, state)
    torch.manual_seed(steps)  # a later run draws other rays
    due = max(FIRST, GROWTH * spent)
    rays = trainer.pipeline.datamanager.get_train_rays_per_batch()
    while spent < seconds:
        began = time.process_time()
        step_once(trainer, steps)
        spent += time.process_time() - began
        steps += 1
        if spent >= min(due, seconds):
            due = GROWTH * spent
            psnr = held_out_psnr(trainer, pixels)
            print(json.dumps({"seconds": spent, "steps": steps, "rays": steps * rays, "psnr": psnr}), flush=True)
            if state is not None:
                keep(trainer, state, steps, spent)


def main() -> None:
    """Parse and train."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seconds", type=float, required=True)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rays", type=int, default=4096, help="per step; nerfacto's default is 4096")
    parser.add_argument("--state", type=Path)
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    import_torchvision()
    torch.manual_seed(0)
    trainer = trainer_of(arguments.folder.resolve(), arguments.rays)
    train(trainer, arguments.seconds, torch.from_numpy(np.load(arguments.folder / "held_out.npy")), arguments.state)


if __name__ == "__main__":
    main()
