"""From an HTTP answer to a value or an exception."""

from typing import Any

import httpx

from scanclient.errors import problem


def checked(answer: httpx.Response) -> httpx.Response:
    """The answer, if it is a success; raises the `Problem` it carries otherwise."""
    if answer.is_success:
        return answer
    raise problem(answer.status_code, _body(answer), _seconds(answer.headers.get("retry-after")))


def _seconds(header: str | None) -> float | None:
    """`Retry-After` in seconds; a date is not read."""
    return float(header) if header and header.isascii() and header.isdigit() else None


def _body(answer: httpx.Response) -> dict[str, Any]:
    """The problem's JSON; what is no JSON object (a proxy's page) becomes a detail."""
    try:
        body = answer.json()
    except ValueError:
        body = None
    if isinstance(body, dict):
        return body
    return {"detail": f"The service answered {answer.status_code} {answer.reason_phrase}."}
