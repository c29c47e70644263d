"""What the API says of steps and their logs."""

from datetime import datetime

from pydantic import BaseModel, Field
from scanjobs.log_lines import Written

from services.api.schemas import StepDetail, instant


class StepPage(BaseModel):
    """Steps of the present generation, in the order they may run."""

    items: list[StepDetail]
    next_cursor: str | None = Field(description="Opaque; null on the last page.")


class LogText(BaseModel):
    """A line that a step wrote."""

    id: int
    step: str | None = Field(description="Kind of the step.")
    frame: int | None
    step_id: str | None
    attempt: int = Field(description="Which attempt of the step wrote it, counted from 1 over all its claims.")
    level: str
    text: str
    at: datetime | None

    @classmethod
    def of(cls, line: Written) -> "LogText":
        return cls(
            id=line.id,
            step=line.kind,
            frame=line.frame,
            step_id=line.step_id,
            attempt=line.token,
            level=line.level,
            text=line.text,
            at=instant(line.at),
        )


class LogPage(BaseModel):
    """Lines, oldest first."""

    items: list[LogText]
    after: int = Field(description="Give it to the next request.")
