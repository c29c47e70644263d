"""What travels through the broker: a task's name, its queue, and the id of one step. Nothing else."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

INSPECT = "scan.inspect"
RENDER = "frame.render"
READ = "frame.read"
TRAIN = "frame.train"
EXTRACT = "frame.extract"
IDENTIFY = "scan.identify"

TRAIN_CPU = "train-cpu"
TRAIN_GPU = "train-gpu"
QUEUE_OF: Mapping[str, str] = MappingProxyType(
    {
        INSPECT: "extract",
        RENDER: "render",
        READ: "extract",
        TRAIN: TRAIN_CPU,
        EXTRACT: "extract",
        IDENTIFY: "identify",
    }
)
"""Task name → queue, in the order in which a scan goes through them; the plan sends large networks to TRAIN_GPU."""

KINDS = tuple(QUEUE_OF)
QUEUES = ("render", TRAIN_CPU, TRAIN_GPU, "extract", "identify")


@dataclass(frozen=True, slots=True)
class Message:
    """One ring of the doorbell."""

    kind: str
    queue: str
    step_id: str
