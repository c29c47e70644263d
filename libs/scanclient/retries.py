"""What is worth sending again: a connection that broke, and a service that says 'not now' (502, 503, 504) or 'not so
fast' (429).
"""

from collections.abc import Callable

import httpx

from scanclient.errors import ConnectionFailed, ServiceFailed, TooManyRequests

NOT_NOW = frozenset({502, 503, 504})
LONGEST_WAIT_S = 60.0


def worth_retrying(*, repeatable: bool) -> Callable[[Exception], bool | float]:
    """The test for one request: whether to repeat it, or after how many seconds.

    What may not be sent twice is only repeated where it never arrived, or was turned away at the door.
    """
    broken = (httpx.TransportError,) if repeatable else (httpx.ConnectError, httpx.ConnectTimeout)

    def test(error: Exception) -> bool | float:
        if isinstance(error, TooManyRequests):
            return min(error.retry_after_s or 1.0, LONGEST_WAIT_S)
        if isinstance(error, ServiceFailed) and error.status in NOT_NOW:
            return min(error.retry_after_s, LONGEST_WAIT_S) if error.retry_after_s else True
        return isinstance(error, broken)

    return test


def unreachable(address: str, error: httpx.TransportError) -> ConnectionFailed:
    """What a user reads when all retries are spent."""
    reason = str(error) or type(error).__name__
    return ConnectionFailed(
        f"no answer from {address} ({reason}): is the service running? Start one with: nerfmodal up"
    )
