"""What was computed of a plant, handed from the analysis to the documents and the alarms."""

from dataclasses import dataclass

from scanjobs.fleet.tables import Observation, PlantScan, Track
from scanjobs.monitoring.drift import Drift, History


@dataclass(frozen=True, slots=True)
class Findings:
    """What is known of a plant after its scans were joined. `tracks[k]` is column k of the history."""

    scans: tuple[PlantScan, ...]
    modes: tuple[Observation, ...]
    tracks: tuple[Track, ...]
    history: History
    drift: Drift | None
