"""One line per event: JSON for machines or text for a terminal, with the scan, step and request that it is about.

Modules go on using `logging`. What a thread or task binds with `about` stands in every line that it logs, whoever logs
it. Passwords in URLs and API keys are struck out before anything is written.
"""

import logging
import re
import sys
from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from typing import Any, Final

import structlog
from structlog.typing import EventDict, Processor

from scanjobs.settings import Settings

SECRETS: Final = (
    (re.compile(r"(?<=://)[^/@\s]*@"), "***@"),
    (re.compile(r"\bnm_[A-Za-z0-9_-]{8,}"), "nm_***"),
    (re.compile(r"\bwhsec_[A-Za-z0-9+/=_-]{8,}"), "whsec_***"),
    (re.compile(r"(?i)\b(bearer +|(?:password|secret)\s*[=:]\s*)[^\s,;&\"']{4,}"), r"\1***"),
)
TALKATIVE: Final = ("celery", "kombu", "alembic", "amqp")
"""Libraries that tell of every message."""
ON_THEIR_OWN: Final = ("uvicorn", "uvicorn.error", "uvicorn.access")
"""Loggers that come with handlers of their own."""


def configure(settings: Settings) -> None:
    """Let this process log as the settings say, to stderr; once, where the process begins."""
    shared: list[Processor] = [
        structlog.contextvars.merge_contextvars,
        structlog.stdlib.add_log_level,
        structlog.stdlib.add_logger_name,
        structlog.stdlib.ExtraAdder(),
        structlog.processors.TimeStamper(fmt="iso", utc=True),
        structlog.processors.format_exc_info,
        strike_secrets,
    ]
    last: Processor = (
        structlog.processors.JSONRenderer(ensure_ascii=False, default=str)
        if settings.log_format == "json"
        else structlog.dev.ConsoleRenderer(colors=False)
    )
    formatter = structlog.stdlib.ProcessorFormatter(
        foreign_pre_chain=shared, processors=[structlog.stdlib.ProcessorFormatter.remove_processors_meta, last]
    )
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(formatter)
    root = logging.getLogger()
    root.handlers = [handler]
    root.setLevel(settings.log_level.upper())
    for name in TALKATIVE:
        logging.getLogger(name).setLevel(max(logging.WARNING, root.level))
    for name in ON_THEIR_OWN:
        logging.getLogger(name).handlers = []
        logging.getLogger(name).propagate = name != "uvicorn.access"  # the API logs its own answers, with their ids


@contextmanager
def about(**ids: str | int) -> Iterator[None]:
    """Everything that this thread logs in the block is about these: `scan_id`, `step_id`, `request_id` …"""
    with structlog.contextvars.bound_contextvars(**ids):
        yield


def strike_secrets(logger: Any, method: str, event: MutableMapping[str, Any]) -> EventDict:  # noqa: ARG001
    """Strike passwords and keys out of every text of a line; a processor of structlog."""
    event.pop("color_message", None)  # uvicorn says everything twice
    return {key: without_secrets(value) if isinstance(value, str) else value for key, value in event.items()}


def without_secrets(text: str) -> str:
    """The text with passwords in URLs, API keys and secrets of webhooks struck out."""
    for pattern, instead in SECRETS:
        text = pattern.sub(instead, text)
    return text
