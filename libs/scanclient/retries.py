"""What is worth sending again: a connection that broke and a service that says 'not now' (502, 503, 504)."""

from collections.abc import Callable

import httpx

from scanclient.errors import ConnectionFailed, ServiceFailed

NOT_NOW = frozenset({502, 503, 504})


def worth_retrying(*, repeatable: bool) -> Callable[[Exception], bool]:
    """The test for one request; what may not be sent twice is only repeated where it never arrived."""
    broken = (httpx.TransportError,) if repeatable else (httpx.ConnectError, httpx.ConnectTimeout)
    return lambda error: isinstance(error, broken) or (isinstance(error, ServiceFailed) and error.status in NOT_NOW)


def unreachable(address: str, error: httpx.TransportError) -> ConnectionFailed:
    """What a user reads when all retries are spent."""
    reason = str(error) or type(error).__name__
    return ConnectionFailed(
        f"no answer from {address} ({reason}): is the service running? Start one with: nerfmodal up"
    )
