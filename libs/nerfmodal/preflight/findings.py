"""What preflight has to say: every rule with its code, the key it is about, and the remedy.

Each rule is a function from what is known to findings; `all_findings` asks them in a fixed order. The numbers behind
the rules were measured (docs/explanation/preflight.md).
"""

from collections.abc import Iterator, Sequence

from nerfmodal.preflight.answer import Cost, Excitation, Finding, ModeForecast, Optics, RecordLimits
from nerfmodal.preflight.expected import FEWEST_PERIODS, ExpectedMode
from nerfmodal.preflight.forecast import closest
from nerfmodal.spec import ScanSpec, SimulationSource

FEWEST_FRAMES = 16
AMBIENT_PERIODS, AMBIENT_DAMPING_PERIODS = 20.0, 130.0
"""Of wind: with 6.5 periods (3 s) a quarter of the modes was missing; with 130 (60 s) all were found."""
WEAK_SHARE, DOUBLE_SHARE = 0.02, 0.2
HARMONIC_HZ = 0.08
SHOULD_BE_LIKELY = ("likely", "unknown")


def all_findings(
    spec: ScanSpec,
    excitation: Excitation,
    record: RecordLimits | None,
    optics: Optics | None,
    expected: Sequence[ExpectedMode],
    modes: Sequence[ModeForecast],
    cost: Cost | None,
) -> tuple[Finding, ...]:
    """Everything that there is to say, the gravest first."""
    found = [*_unknown(record, optics, expected), *_cost(spec, cost)]
    if record is not None:
        found += [*_length(record), *_excitation(excitation, record, modes), *_aliases(record, expected)]
        found += [*_periods(expected, modes), *_noise(expected, modes), *_company(record, expected)]
    if isinstance(spec.source, SimulationSource) and not expected:
        found.append(
            Finding(
                severity="warn",
                code="NOTHING_MOVES",
                pointer="/source/motion",
                message="No mode is imposed: the right answer is that there is none.",
                hint="Add a mode to motion, unless that is what you want to test.",
            )
        )
    order = ("refuse", "warn", "note")
    return tuple(sorted(found, key=lambda one: order.index(one.severity)))


def _unknown(record: RecordLimits | None, optics: Optics | None, expected: Sequence[ExpectedMode]) -> Iterator[Finding]:
    if record is None:
        yield Finding(
            severity="note",
            code="RECORD_UNKNOWN",
            pointer="/source/path",
            message="How many frames there are, and how fast they follow, is known only once the source is read.",
            hint="Ask `nerfmodal preflight` where the files are: it looks inside.",
        )
    elif optics is None:
        yield Finding(
            severity="note",
            code="NOISE_UNKNOWN",
            pointer="/source",
            message="The noise of these clouds is not known: deviations are for amplitudes of ten times the noise.",
            hint="Give --noise-mm, the standard deviation of a fitted surface in one frame.",
        )
    if record is not None and not expected:
        yield Finding(
            severity="note",
            code="MODES_UNKNOWN",
            pointer="/source",
            message="Nobody has said which modes are expected; `resolves` shows what the record can do.",
            hint="Give --mode HZ:DAMPING:MM for each mode that you expect.",
        )


def _length(record: RecordLimits) -> Iterator[Finding]:
    if record.frames < FEWEST_FRAMES:
        yield Finding(
            severity="refuse",
            code="TOO_FEW_FRAMES",
            pointer="/source/frames",
            message=f"{record.frames} frames hold no modes: {FEWEST_FRAMES} are needed at the least.",
            hint="Record 90 frames, and two periods of the slowest mode.",
        )


def _excitation(excitation: Excitation, record: RecordLimits, modes: Sequence[ModeForecast]) -> Iterator[Finding]:
    if excitation == "harmonic":
        yield Finding(
            severity="warn",
            code="DAMPING_NOT_SEEN",
            pointer="/source/excitation",
            message="Steady motion does not decay: damping cannot be read from it.",
            hint="Pull and let go for damping.",
        )
    if excitation != "ambient":
        return
    periods = min((mode.periods for mode in modes), default=record.duration_s)
    if periods < AMBIENT_PERIODS:
        yield Finding(
            severity="refuse",
            code="AMBIENT_TOO_SHORT",
            pointer="/source/frames",
            message=f"Wind for {record.duration_s:.3g} s ({periods:.3g} periods of the slowest mode): at 3 s a "
            "quarter of the modes is lost, frequencies are off by 40 to 50 mHz and damping by 1 to 2 points.",
            hint="Record 60 s of wind, or pull and let go: 3 s of free decay read a frequency to a few millihertz.",
        )
    elif periods < AMBIENT_DAMPING_PERIODS:
        yield Finding(
            severity="warn",
            code="AMBIENT_DAMPING_POOR",
            pointer="/source/frames",
            message=f"Wind for {periods:.3g} periods of the slowest mode finds the modes, but not their damping.",
            hint=f"Damping needs {AMBIENT_DAMPING_PERIODS:g} periods and more.",
        )


def _aliases(record: RecordLimits, expected: Sequence[ExpectedMode]) -> Iterator[Finding]:
    for mode in expected:
        if mode.frequency > record.highest_hz:
            yield Finding(
                severity="refuse",
                code="ALIAS",
                pointer=mode.pointer,
                message=f"{mode.frequency:g} Hz cannot be told from its alias at {record.frame_rate_hz:g} frames/s.",
                hint=f"Film at {2.3 * mode.frequency:.3g} frames/s or more.",
            )


def _periods(expected: Sequence[ExpectedMode], modes: Sequence[ModeForecast]) -> Iterator[Finding]:
    for mode, told in zip(expected, modes, strict=bool(modes)):
        if told.periods < FEWEST_PERIODS:
            yield Finding(
                severity="warn",
                code="RECORD_TOO_SHORT",
                pointer=mode.pointer,
                message=f"{_name(mode)} has {told.periods:.2g} periods in the record; it would be doubtful.",
                hint=f"Record {FEWEST_PERIODS / mode.frequency:.3g} s or more; ten periods are good.",
            )


def _noise(expected: Sequence[ExpectedMode], modes: Sequence[ModeForecast]) -> Iterator[Finding]:
    for mode, told in zip(expected, modes, strict=bool(modes)):
        if told.found not in SHOULD_BE_LIKELY:
            yield Finding(
                severity="warn",
                code="BELOW_NOISE",
                pointer=mode.pointer,
                message=f"{_name(mode)} moves {1e3 * mode.amplitude:.3g} mm, {told.amplitude_to_noise:.2g} times the "
                f"noise of a frame: it is {'found in some records' if told.found == 'uncertain' else 'hardly found'}.",
                hint="Excite it more, come nearer, use finer pictures, or record for longer.",
            )


def _company(record: RecordLimits, expected: Sequence[ExpectedMode]) -> Iterator[Finding]:
    """What other modes of the same organ do to a mode."""
    for first, second, distance in closest(expected):
        if distance < record.bin_width_hz:
            yield Finding(
                severity="warn",
                code="CLOSE_MODES",
                pointer=expected[second].pointer,
                message=f"{_name(expected[first])} and {_name(expected[second])} are {distance:.2g} Hz apart, nearer "
                f"than the record's {record.bin_width_hz:.2g} Hz: both are read worse than is said here.",
                hint=f"Record {1 / max(distance, 1e-3):.3g} s or more.",
            )
    for mode in expected:
        mine = [other for other in expected if other.organ == mode.organ]
        strongest = max(other.amplitude for other in mine)
        if mode.amplitude < WEAK_SHARE * strongest:
            yield _drowned(mode, "WEAK", f"has less than {WEAK_SHARE:.0%} of the strongest mode; it would be doubtful")
        elif any(_doubles(mode, other) for other in mine):
            yield _drowned(mode, "HARMONIC", "is twice the frequency of one five times as strong: it would be rejected")


def _drowned(mode: ExpectedMode, code: str, what: str) -> Finding:
    return Finding(
        severity="warn",
        code=code,
        pointer=mode.pointer,
        message=f"{_name(mode)} {what}.",
        hint="Excite this mode more, or the strong one less.",
    )


def _doubles(mode: ExpectedMode, other: ExpectedMode) -> bool:
    return abs(mode.frequency - 2 * other.frequency) < HARMONIC_HZ and mode.amplitude < DOUBLE_SHARE * other.amplitude


def _cost(spec: ScanSpec, cost: Cost | None) -> Iterator[Finding]:
    if cost is None:
        return
    if spec.deadline_s is not None and cost.elapsed_s > spec.deadline_s:
        yield Finding(
            severity="refuse",
            code="DEADLINE",
            pointer="/deadline_s",
            message=f"The scan takes about {cost.elapsed_s:.0f} s on {cost.slots} slots; its deadline is "
            f"{spec.deadline_s:.0f} s.",
            hint="Give it more time or more workers, or fewer frames, cameras or iterations.",
        )
    if any(step.basis == "reference" for step in cost.steps):
        yield Finding(
            severity="note",
            code="NO_HISTORY",
            pointer="",
            message="Some steps have not run here yet: their time is that of a reference machine (one core each).",
            hint="After the first scan the time is that of these workers.",
        )


def _name(mode: ExpectedMode) -> str:
    return f"{mode.organ} at {mode.frequency:g} Hz" if mode.organ else f"The mode at {mode.frequency:g} Hz"
