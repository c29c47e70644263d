"""docs/reproduction.md out of the stored result: every number of the page stands in docs/reproduction.json."""

from collections.abc import Iterator, Sequence
from typing import Any

from nerfmodal.reproduction.document import goals_of
from nerfmodal.reproduction.scores import ACTIVE_SHARE

Document = dict[str, Any]
NONE = "–"


def page(stored: Document) -> str:
    """The page in Markdown."""
    return "\n".join([*_head(stored), *(line for one in stored["experiments"] for line in _experiment(one))]) + "\n"


def _head(stored: Document) -> list[str]:
    machine = stored["machine"]
    return [
        "<!-- Written from reproduction.json by docs/reproduce.py: run the experiment again, do not edit. -->",
        "",
        "# The paper's experiment, again",
        "",
        "T. F. Ribeiro, V. H. R. Cardoso, J. C. W. A. Costa and M. F. Silva imposed modes of 2, 5 and 10 Hz on the",
        "five leaves of an açai palm and one of 1 Hz on its stem, rendered it, and found the leaves' frequencies",
        "again. Here the same is done from rendered pictures alone, and every number stands beside what was imposed.",
        "The paper's frequencies lie exactly on the lines of its Fourier transform (1/3 Hz apart), where a peak has no",
        "error by construction; `paper-off-bin` has others.",
        "",
        "```sh",
        stored["command"],
        "```",
        "",
        f"nerfmodal {stored['version']}, {machine['cores']} cores, {machine['memory_gib']:g} GiB memory, "
        f"Python {machine['python']}; {_minutes(stored['seconds'])} in all"
        f"{', in several runs' if stored['resumed'] else ''}.",
        "",
        "Damping, phases and amplitudes are ours: the paper gives none. It reports neither damping nor MAC, and of its",
        f"branch no frequency. An eigenvalue is called active from {ACTIVE_SHARE:.0%} of the largest; the paper gives",
        "no rule. The displacement error is the root mean square over all sensors and frames, over that of the imposed",
        "motion.",
    ]


def _experiment(one: Document) -> Iterator[str]:
    yield from (
        "",
        f"## {one['name']}",
        "",
        f"{one['frames']} frames at {one['frame_rate_hz']:g} Hz, {one['cameras']} cameras of {one['width_px']} × "
        f"{one['height_px']} pixels ({one['renderer']}, {one['samples']} rays a pixel), {one['field']} field, "
        f"{one['iterations']} + {one['fine_tune_iterations']} iterations, `motion: {one['motion']}`, "
        f"seed {one['seed']}; {_minutes(one['seconds'])}.",
        "",
        "| goal | reached | wanted | |",
        "|---|---|---|---|",
    )
    for goal in goals_of(one):
        met = "met" if goal["met"] else "**missed**"
        yield f"| {goal['what']} | {_unit(goal['reached'], goal)} | {_unit(goal['goal'], goal)} | {met} |"
    yield from ("", *_modes(one["modes"]), "", *_organs(one["organs"]))


def _modes(rows: Sequence[Document]) -> list[str]:
    head = [
        "| organ | shape | paper Hz | truth Hz | ours Hz | truth ζ | ours ζ | MAC | verdict |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    return head + [
        f"| {row['organ']} | {row['shape'] or NONE} | {_number(row['paper_hz'], 0)} | {_number(row['truth_hz'], 2)} | "
        f"{_with_std(row['found_hz'], row['found_hz_std'], 5)} | {_percent(row['truth_damping'])} | "
        f"{_with_std(_hundred(row['found_damping']), _hundred(row['found_damping_std']), 3)} % | "
        f"{_number(row['mac'], 3)} | {row['verdict'] or 'not found'} |"
        for row in rows
    ]


def _organs(rows: Sequence[Document]) -> list[str]:
    head = [
        "| organ | active eigenvalues: paper | truth | ours | displacement error |",
        "|---|---|---|---|---|",
    ]
    return head + [
        f"| {row['organ']} | {_number(row['paper_active_eigenvalues'], 0)} | {row['truth_active_eigenvalues']} | "
        f"{row['active_eigenvalues']} | {_percent(row['displacement_error'], 1)} |"
        for row in rows
    ]


def _unit(value: float | int, goal: Document) -> str:
    digits = 0 if goal["unit"] == "modes" else 3
    return f"{value:.{digits}f} {goal['unit']}".rstrip()


def _number(value: float | int | None, digits: int) -> str:
    return NONE if value is None else f"{value:.{digits}f}"


def _percent(value: float | None, digits: int = 2) -> str:
    return NONE if value is None else f"{100 * value:.{digits}f} %"


def _hundred(value: float | None) -> float | None:
    return None if value is None else 100 * value


def _with_std(value: float | None, std: float | None, digits: int) -> str:
    if value is None:
        return NONE
    return f"{value:.{digits}f}" if std is None else f"{value:.{digits}f} ± {std:.{digits}f}"


def _minutes(seconds: float | int) -> str:
    return f"{seconds / 60:.1f} minutes" if seconds >= 60 else f"{seconds:.0f} s"
