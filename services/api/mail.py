"""E-mail: a webhook whose address is `mailto:…` is told by the operator's SMTP server, out of the same outbox.

An alarm or a scan becomes a short text with the whole message attached as JSON. A server that refuses the recipient for
good (5xx) is an attempt that failed like any other: the outbox tries again for a day, and the log says why.
"""

import json
import re
import smtplib
import ssl
import time
from email.headerregistry import Address
from email.message import EmailMessage
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from scanjobs.settings import Settings
from scanjobs.webhooks import Claimed, Outcome

from services.api.errors import RequestRefused

SCHEME: Final = "mailto:"
ADDRESS: Final = re.compile(r"[A-Za-z0-9.!#$%&'*+/=?^_`{|}~-]{1,64}@[A-Za-z0-9](?:[A-Za-z0-9.-]{0,250}[A-Za-z0-9])?")
PATIENCE_S: Final = 20.0
ACCEPTED: Final = 250


def is_mail(url: str) -> bool:
    """Whether an endpoint is told by e-mail."""
    return url.lower().startswith(SCHEME)


def refuse_unmailable(settings: Settings, url: str) -> None:
    """Raise `RequestRefused` where no server is set, or this is no plain address."""
    if not settings.smtp_url:
        hint = "Ask the operator to set NERFMODAL_SMTP_URL, or use an https address."
        raise RequestRefused(422, "NO_MAIL_SERVER", "This service sends no e-mail.", pointer="/url", hint=hint)
    if not ADDRESS.fullmatch(url[len(SCHEME) :]):
        hint = "Write mailto:name@example.org, one address and nothing else."
        raise RequestRefused(422, "INVALID_BODY", "This is no e-mail address.", pointer="/url", hint=hint)


def send_mail(settings: Settings, claimed: Claimed) -> Outcome:
    """Send one delivery; whatever happens is an outcome."""
    began = time.monotonic()
    try:
        _send(settings, message_of(settings, claimed))
    except (smtplib.SMTPException, OSError, ValueError) as error:
        return Outcome(took_s=time.monotonic() - began, error=f"{type(error).__name__}: {error}"[:255])
    return Outcome(took_s=time.monotonic() - began, status=ACCEPTED, answer="accepted by the mail server")


def message_of(settings: Settings, claimed: Claimed) -> EmailMessage:
    """The message: the same id in every attempt, so that a reader sees one that came twice as one."""
    sender = settings.smtp_from or "nerfmodal@localhost"
    message = EmailMessage()
    message["From"] = Address("nerfmodal", addr_spec=sender)
    message["To"] = claimed.url[len(SCHEME) :]
    message["Subject"] = subject_of(claimed.payload)
    message["Message-ID"] = f"<{claimed.id}@{sender.partition('@')[2] or 'localhost'}>"
    message["Auto-Submitted"] = "auto-generated"
    message.set_content(text_of(claimed.payload))
    document = json.dumps(claimed.payload, indent=2, ensure_ascii=False).encode()
    message.add_attachment(document, maintype="application", subtype="json", filename="message.json")
    return message


def subject_of(payload: dict[str, Any]) -> str:
    """One line: what happened to what."""
    data = payload.get("data", {})
    if payload["type"].startswith("alarm."):
        line = f"[{data['severity']}] {data['plant_name']}: {data['title']} ({data['state']})"
    else:
        line = f"{payload['type']}: {data.get('name') or data.get('scan') or 'a test'}"
    return " ".join(line.split())


def text_of(payload: dict[str, Any]) -> str:
    """What a person reads."""
    data = payload.get("data", {})
    if payload["type"].startswith("alarm."):
        lines = [data["what"], "", f"Plant {data['plant']}, treatment {data['treatment'] or 'none'}."]
        lines += [f"Alarm /v1/alarms/{data['id']} is {data['state']}."] + ([data["note"]] if data["note"] else [])
    else:
        lines = [f"{payload['type']} at {payload['timestamp']}", f"{data.get('href', '')}"]
    return "\n".join(lines) + "\n"


def _send(settings: Settings, message: EmailMessage) -> None:
    server = urlsplit(settings.smtp_url)
    host, secure = server.hostname or "localhost", server.scheme == "smtps"
    context = ssl.create_default_context()
    if secure:
        connection: smtplib.SMTP = smtplib.SMTP_SSL(host, server.port or 465, timeout=PATIENCE_S, context=context)
    else:
        connection = smtplib.SMTP(host, server.port or 25, timeout=PATIENCE_S)
    with connection:
        if server.scheme == "smtp+starttls":
            connection.starttls(context=context)
        if server.username:
            connection.login(unquote(server.username), unquote(server.password or ""))
        connection.send_message(message)
