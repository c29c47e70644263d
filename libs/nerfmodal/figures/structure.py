"""Motions that several organs share (`ScanResult.structure`): all of them in one picture, drawn as modes are.

Organs move in different directions: each is coloured by its displacement along its own, with the sign of its phase.
"""

import numpy as np
from matplotlib.figure import Figure

from nerfmodal.figures.shapes import (
    MOST_COLUMNS,
    MOST_SENSORS,
    SWING,
    DrawnMode,
    draw_mode,
    main_direction,
    panels_of,
    rest_lines_of,
)
from nerfmodal.figures.style import LABEL, measured
from nerfmodal.geometry.skins import skin_of
from nerfmodal.types import OrganResult, ScanResult, StructureMode, Verdict


def structure_shapes(result: ScanResult) -> Figure:
    """Every shared motion at its largest swing, over the organs at rest. There must be one at least."""
    modes = [drawn_structure(mode, result.organs) for mode in result.structure]
    count = len(modes)
    columns = min(MOST_COLUMNS, max(count, 2))
    figure, panels = panels_of(modes, count, columns, "Motions that organs share, magnified")
    for axes, drawn, mode in zip(panels, modes, result.structure, strict=True):
        axes.set_title(_title(mode), fontsize=LABEL)
        draw_mode(axes, drawn, 1.0)
    return figure


def drawn_structure(mode: StructureMode, organs: tuple[OrganResult, ...]) -> DrawnMode:
    """The organs of a shared motion as one drawn mode."""
    by_name = {organ.organ: organ for organ in organs}
    rest, lines, moved, signed, triangles, first, corners = [], [], [], [], [], 0, 0
    for name, amplitude in zip(mode.organs, mode.amplitudes, strict=True):
        organ = by_name[name]
        positions = organ.displacement.sensors.positions
        skin = skin_of(positions, organ.surface, most=MOST_SENSORS // 2)
        rest.append(skin.vertices)
        lines.append(rest_lines_of(organ, skin))
        moved.append(mode.shape[first + skin.sensor])
        signed.append(np.sign(amplitude) * (moved[-1] @ main_direction(moved[-1])))
        triangles.append(skin.triangles + corners)
        first, corners = first + len(positions), corners + len(skin.vertices)
    motion = np.concatenate(moved)
    length = float(np.linalg.norm(np.ptp(mode.positions, axis=0)))
    return DrawnMode(
        rest=np.concatenate(rest),
        rest_lines=np.concatenate(lines),
        motion=motion,
        signed=np.concatenate(signed) / max(float(np.abs(np.concatenate(signed)).max()), 1e-12),
        direction=main_direction(mode.shape),
        triangles=np.concatenate(triangles),
        magnification=SWING * length / max(float(np.linalg.norm(motion, axis=1).max()), 1e-12),
    )


def _title(mode: StructureMode) -> str:
    words = f"{measured(mode.frequency, mode.frequency_std)} Hz: {len(mode.organs)} organs"
    return words if mode.verdict is Verdict.ACCEPTED else f"{words} [{mode.verdict.value}]"
