"""Sending what the outbox holds: a task of the API's process that claims, sends, and writes down what came of it.

Nothing is sent to an address that was not judged a moment before: the connection goes to the judged address itself,
the name is only said in `Host` and to TLS. No redirect is followed, no proxy asked, nothing waited for longer than
`PATIENCE_S`, and of an answer no more is read than the log keeps.
"""

import asyncio
import json
import logging
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import partial
from typing import Final

import httpx
from scanjobs.addresses import AddressRefused, Resolve, Target, judge, resolve
from scanjobs.settings import Settings
from scanjobs.store import Store
from scanjobs.webhooks import Claimed, Outcome, claim_due, record, remove_old
from sqlalchemy.exc import SQLAlchemyError
from standardwebhooks.webhooks import Webhook
from starlette.concurrency import run_in_threadpool

from services.api.mail import is_mail, send_mail

log = logging.getLogger(__name__)

LOOK_S: Final = 1.0
PATIENCE_S: Final = 15.0
ANSWER_BYTES: Final = 400
CLEAN_S: Final = 3600.0
AGENT: Final = "nerfmodal-webhooks/1"


class Deliveries:
    """The task; `resolve` is what names are looked up with."""

    def __init__(self, store: Store, settings: Settings, resolve: Resolve = resolve) -> None:
        self._store = store
        self._settings = settings
        self._private_allowed = settings.webhooks_to_private_addresses
        self._resolve = resolve
        self._cleaned_at = 0.0

    async def run(self) -> None:
        """Send what is due, until cancelled."""
        while True:
            try:
                busy = await self.send_due()
                await self._clean()
            except SQLAlchemyError:  # what is due stays due: the next look tries again
                log.warning("the database does not answer; webhooks wait")
                busy = False
            await asyncio.sleep(0.0 if busy else LOOK_S)

    async def send_due(self) -> bool:
        """Send what is due now; whether there was anything."""
        claimed = await run_in_threadpool(self._store.write, claim_due)
        await asyncio.gather(*(self._send_one(one) for one in claimed))
        return bool(claimed)

    async def _send_one(self, claimed: Claimed) -> None:
        began = time.monotonic()
        outcome = await self.attempt(claimed, began)
        log.info("webhook delivery %s, attempt %s: %s", claimed.id, claimed.number, outcome.status or outcome.error)
        await run_in_threadpool(self._store.write, partial(record, claimed=claimed, outcome=outcome))

    async def attempt(self, claimed: Claimed, began: float) -> Outcome:
        """Send a delivery once; whatever happens is an outcome."""
        if is_mail(claimed.url):
            return await run_in_threadpool(send_mail, self._settings, claimed)
        look = partial(judge, claimed.url, private_allowed=self._private_allowed, resolve=self._resolve)
        try:
            async with asyncio.timeout(PATIENCE_S):
                target = await run_in_threadpool(look)
                return await _post(target, claimed, began)
        except AddressRefused as error:
            reason = error.message
        except TimeoutError:
            reason = f"no answer within {PATIENCE_S:g} s"
        except (httpx.HTTPError, OSError, ValueError) as error:
            reason = type(error).__name__
        return Outcome(took_s=time.monotonic() - began, error=reason)

    async def _clean(self) -> None:
        if time.monotonic() - self._cleaned_at > CLEAN_S:
            self._cleaned_at = time.monotonic()
            await run_in_threadpool(self._store.write, remove_old)


def signed_headers(claimed: Claimed, body: str, now: datetime) -> Mapping[str, str]:
    """`webhook-id`, `-timestamp` and `-signature`: one signature for each secret that is valid now."""
    signatures = [Webhook(secret).sign(claimed.id, now, body) for secret in claimed.secrets]
    return {
        "webhook-id": claimed.id,
        "webhook-timestamp": str(int(now.timestamp())),
        "webhook-signature": " ".join(signatures),
    }


def body_of(payload: Mapping[str, object]) -> str:
    """The same bytes for every attempt."""
    return json.dumps(payload, separators=(",", ":"), sort_keys=True)


async def _post(target: Target, claimed: Claimed, began: float) -> Outcome:
    body = body_of(claimed.payload)
    headers = {
        **signed_headers(claimed, body, datetime.now(UTC)),
        "Host": target.host_header,
        "Content-Type": "application/json",
        "User-Agent": AGENT,
    }
    extensions = {"sni_hostname": target.host} if target.scheme == "https" else {}
    async with httpx.AsyncClient(follow_redirects=False, trust_env=False, timeout=PATIENCE_S) as http:
        request = http.build_request("POST", target.url, content=body.encode(), headers=headers, extensions=extensions)
        answer = await http.send(request, stream=True)
        try:
            text = await _beginning(answer)
        finally:
            await answer.aclose()
    return Outcome(
        took_s=time.monotonic() - began,
        status=answer.status_code,
        answer=text,
        retry_after_s=_seconds(answer.headers.get("retry-after")),
    )


async def _beginning(answer: httpx.Response) -> str:
    """The first bytes of an answer as they come, not unpacked: a few may stand for gigabytes."""
    found = b""
    async for block in answer.aiter_raw():
        found += block
        if len(found) >= ANSWER_BYTES:
            break
    return found[:ANSWER_BYTES].decode(errors="replace")


def _seconds(header: str | None) -> float | None:
    return float(header) if header and header.isascii() and header.isdigit() and len(header) < 7 else None
