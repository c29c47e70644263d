"""Draw the pictures of docs/explanation/simulation.md: `python docs/pictures/draw.py` (two minutes, with Blender)."""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from nerfmodal.simulate import acai, render_frame, vertices_at
from nerfmodal.simulate.excitation import modal_coordinate, wind_spectrum
from nerfmodal.spec import (
    AirPulse,
    Excitation,
    FreeDecay,
    Harmonic,
    ImposedMode,
    RigSpec,
    SensorSpec,
    SimulationSource,
    Wind,
)
from PIL import Image
from scipy.signal import welch

HERE = Path(__file__).parent
RIGS = {
    "acai": RigSpec(cameras=9, width_px=240, height_px=300, radius_m=3.2, target_m=(0, 0, 1.45)),
    "herb": RigSpec(cameras=9, width_px=240, height_px=300, radius_m=1.15, target_m=(0, 0, 0.37)),
    "tree": RigSpec(cameras=9, width_px=240, height_px=300, radius_m=3.1, target_m=(0, 0, 1.3)),
    "plate": RigSpec(cameras=9, width_px=240, height_px=300, radius_m=2.4, target_m=(0.1, 0, 0.9)),
    "tower": RigSpec(cameras=9, width_px=240, height_px=300, radius_m=3.7, target_m=(0, 0, 1.5)),
}
VIEWS = [0, 3, 5]
MODE = ImposedMode(organ="leaf_*", shape="bending_1", frequency_hz=2.17, damping_ratio=0.02, amplitude_m=0.05)
SWAY = ImposedMode(organ="mast", shape="bending_1", frequency_hz=2.0, amplitude_m=0.25, phase_deg=90)


def nothing(_done: int, _total: int) -> None:
    """Progress that nobody reads."""


def structures() -> None:
    """All structures from three sides, filmed by Blender."""
    columns = []
    for structure, rig in RIGS.items():
        source = SimulationSource(
            kind="simulation", structure=structure, frames=1, frame_rate_hz=30, motion=(), rig=rig, samples=24
        )
        columns.append(np.concatenate(list(render_frame(source, 0, 0, report=nothing).images[VIEWS])))
    Image.fromarray(np.concatenate(columns, axis=1)).save(HERE / "structures.jpg", quality=82, optimize=True)


def flaws() -> None:
    """One camera's picture of the swinging tower with each flaw of a sensor, ray-cast."""
    rig = RigSpec(cameras=3, width_px=150, height_px=300, radius_m=2.6, target_m=(0, 0, 2.1), field_of_view_deg=40)
    sensors = [
        SensorSpec(),
        SensorSpec(full_well_e=250, read_noise_e=6),
        SensorSpec(exposure_spread_ev=0.9, white_balance_spread=0.25, seed=5),
        SensorSpec(shutter_s=0.1, instants=16),
        SensorSpec(rolling_shutter_s=0.5, instants=60),
    ]
    pictures = []
    for sensor in sensors:
        source = SimulationSource(
            kind="simulation",
            structure="tower",
            frames=1,
            frame_rate_hz=30,
            motion=(SWAY,),
            excitation=Harmonic(kind="harmonic"),
            rig=rig,
            renderer="preview",
            samples=16,
            sensor=sensor,
        )
        pictures.append(render_frame(source, 0, 0, report=nothing).images[1])
    Image.fromarray(np.concatenate(pictures, axis=1)).save(HERE / "flaws.jpg", quality=85, optimize=True)


def excitations() -> None:
    """The four excitations of one mode, the wind's spectrum beside its closed form, and harmonics of a turning leaf."""
    figure, (motion, spectrum, harmonics) = plt.subplots(1, 3, figsize=(11, 3.1), layout="constrained")
    times = np.arange(0, 6, 1 / 100)
    forces: dict[str, Excitation] = {
        "free_decay": FreeDecay(),
        "harmonic": Harmonic(kind="harmonic"),
        "wind": Wind(kind="wind", high_hz=15),
        "pulse": AirPulse(kind="pulse", at_s=1.0, duration_s=0.1),
    }
    for row, (name, force) in enumerate(forces.items()):
        motion.plot(times, 1000 * modal_coordinate(MODE, times, force, duration=6.0) - 150 * row, linewidth=1.2)
        motion.text(0, 50 - 150 * row, name, fontsize=8)
    motion.set(xlabel="time, s", yticks=[], title="one mode, four excitations")
    _spectrum(spectrum)
    _harmonics(harmonics)
    figure.savefig(HERE / "excitations.png", dpi=90)


def _spectrum(axes: plt.Axes) -> None:
    wind, long = Wind(kind="wind", low_hz=0.5, high_hz=12), np.arange(0, 600, 1 / 30)
    frequencies, power = welch(modal_coordinate(MODE, long, wind, duration=600.0), fs=30, nperseg=1800)
    axes.semilogy(frequencies, power, label="600 s of wind, Welch", linewidth=0.8)
    fine = np.linspace(0.5, 12, 2000)
    axes.semilogy(fine, wind_spectrum(MODE, wind, fine), label="closed form", linewidth=1.5)
    axes.set(xlabel="frequency, Hz", ylabel="m²/Hz", ylim=(1e-9, 1e-1), title="response to wind, 0.5 to 12 Hz")
    axes.legend(fontsize=7)


def _harmonics(axes: plt.Axes) -> None:
    plant, amplitudes = acai(), np.array([0.01, 0.02, 0.05, 0.1, 0.2])
    tip = np.flatnonzero(plant.belongs("leaf_0") & (plant.along == 1.0))[0]
    lines = []
    for amplitude in amplitudes:
        mode = MODE.model_copy(update={"frequency_hz": 2.0, "amplitude_m": float(amplitude)})
        source = SimulationSource(
            kind="simulation",
            frames=1,
            frame_rate_hz=30,
            motion=(mode,),
            excitation=Harmonic(kind="harmonic"),
            kinematics="rotation",
        )
        track = np.stack([vertices_at(plant, source, k / 32)[tip] for k in range(16)])
        lines.append(np.linalg.norm(np.fft.rfft(track, axis=0), axis=1)[1:4] / 8)
    for order, line in enumerate(np.transpose(lines), start=1):
        axes.loglog(amplitudes, line, "o-", label=f"{order} f")
    axes.set(xlabel="amplitude_m", ylabel="tip of a leaf, m", title="kinematics: rotation", ylim=(1e-6, 1))
    axes.legend(fontsize=7)


if __name__ == "__main__":
    structures()
    flaws()
    excitations()
