"""Specifications that a user starts from, of the simulated açai palm.

Motion follows the paper: every leaf bends at 2 and 5 Hz and twists at 10 Hz along z, the trunk bends at 1 Hz along x.
The paper gives neither amplitudes nor damping nor phases; these are ours. Phases differ so that leaves do not move
in step. All its frequencies are multiples of 1/3 Hz, on which the transform of 3 s has its lines: `paper-off-bin` has
others. Its leaves do not ride on the trunk; those of `paper-coupled` do.
"""

from collections.abc import Mapping
from types import MappingProxyType

from nerfmodal.spec import ImposedMode, ReconstructionSpec, RigSpec, ScanSpec, SimulationSource

LEAVES = 5
DAMPING_RATIO = 0.01
PAPER_HZ = (2, 5, 10, 1)
"""Of a leaf's two bendings and its torsion, and of the trunk."""
OFF_BIN_HZ = (2.17, 4.83, 9.61, 1.07)


def _motion(frequencies: tuple[float, float, float, float] = PAPER_HZ) -> tuple[ImposedMode, ...]:
    leaves = [mode for leaf in range(LEAVES) for mode in _leaf_motion(leaf, frequencies)]
    trunk = ImposedMode(
        organ="trunk",
        shape="bending_1",
        frequency_hz=frequencies[3],
        damping_ratio=DAMPING_RATIO,
        amplitude_m=0.04,
        phase_deg=20,
    )
    return (*leaves, trunk)


def _leaf_motion(leaf: int, frequencies: tuple[float, float, float, float]) -> list[ImposedMode]:
    """Three modes whose phases are those of no other leaf."""
    name, turn = f"leaf_{leaf}", 360 * leaf / LEAVES
    first = ImposedMode(
        organ=name,
        shape="bending_1",
        frequency_hz=frequencies[0],
        damping_ratio=DAMPING_RATIO,
        amplitude_m=0.05,
        phase_deg=turn,
    )
    second = ImposedMode(
        organ=name,
        shape="bending_2",
        frequency_hz=frequencies[1],
        damping_ratio=DAMPING_RATIO,
        amplitude_m=0.025,
        phase_deg=(2 * turn + 40) % 360,
    )
    twist = ImposedMode(
        organ=name,
        shape="torsion_1",
        frequency_hz=frequencies[2],
        damping_ratio=DAMPING_RATIO,
        amplitude_m=0.02,
        phase_deg=(3 * turn + 80) % 360,
    )
    return [first, second, twist]


DEFAULT = ScanSpec(
    name="acai",
    source=SimulationSource(kind="simulation", frames=52, frame_rate_hz=25, motion=_motion(), samples=8),
    reconstruction=ReconstructionSpec(
        voxel_m=0.0125,
        iterations=800,
        fine_tune_iterations=120,
        opacity_threshold=0.35,
        points=40_000,
    ),
)
"""What the demo runs: 24 cameras of 224 × 320 pixels, 2.08 seconds at 25 Hz."""

QUICK = ScanSpec(
    name="quick",
    source=SimulationSource(
        kind="simulation",
        frames=40,
        frame_rate_hz=30,
        motion=_motion(),
        rig=RigSpec(cameras=16, width_px=128, height_px=184),
        renderer="preview",
    ),
    reconstruction=ReconstructionSpec(iterations=300, fine_tune_iterations=60, points=20_000),
)
"""A look at everything in a minute or two, ray-cast instead of Blender: its numbers are rough."""


def _paper(name: str, motion: tuple[ImposedMode, ...], *, coupled: bool = False) -> ScanSpec:
    """The paper's experiment at its own scale."""
    return ScanSpec(
        name=name,
        source=SimulationSource(
            kind="simulation",
            frames=90,
            frame_rate_hz=30,
            motion=motion,
            coupled=coupled,
            rig=RigSpec(cameras=50, width_px=1920, height_px=1080),
            samples=64,
        ),
        reconstruction=ReconstructionSpec(
            field="mlp", iterations=17_000, fine_tune_iterations=3_000, opacity_threshold=0.9, points=1_000_000
        ),
    )


PAPER = _paper("paper", _motion())
"""50 Full HD views, 90 frames, 17 k + 3 k iterations: days without a GPU."""
PAPER_COUPLED = _paper("paper-coupled", _motion(), coupled=True)
PAPER_OFF_BIN = _paper("paper-off-bin", _motion(OFF_BIN_HZ))

PRESETS: Mapping[str, ScanSpec] = MappingProxyType(
    {
        "default": DEFAULT,
        "quick": QUICK,
        "paper": PAPER,
        "paper-coupled": PAPER_COUPLED,
        "paper-off-bin": PAPER_OFF_BIN,
    }
)
