"""What every reader of a rig's certificate asks first: that it is one, and whole. See `nerfmodal.certificate`."""

import hashlib
import json
import re
from collections.abc import Mapping
from typing import Any

from nerfmodal.errors import InvalidInput

FORMAT, VERSION = "nerfmodal rig certificate", 1
DIGEST = re.compile("[0-9a-f]{64}")
NOT_OF_THE_DIGEST = ("id", "created")
WHAT_WRITES_ONE = "Give the certificate.json that `nerfmodal certify` wrote, unchanged."


def certificate_id(document: Mapping[str, Any]) -> str:
    """SHA-256 of a certificate's content, but for its id and the date. Raises `ValueError` for what is no JSON."""
    content = {key: value for key, value in document.items() if key not in NOT_OF_THE_DIGEST}
    text = json.dumps(content, sort_keys=True, allow_nan=False, ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def check_certificate(document: Any, where: str | None = None) -> dict[str, Any]:
    """The document, if it is a certificate of this version whose id is that of its content.

    Raises `InvalidInput`.
    """
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InvalidInput("is no certificate of a rig.", where=where, hint=WHAT_WRITES_ONE)
    if document.get("format_version") != VERSION:
        raise InvalidInput(
            f"has version {document.get('format_version')}; this program reads {VERSION}.",
            where=where,
            hint="Certify the rig again.",
        )
    if not _is_whole(document):
        raise InvalidInput(
            "is not whole, or was changed: its id is not that of its content.", where=where, hint=WHAT_WRITES_ONE
        )
    return document


def _is_whole(document: Mapping[str, Any]) -> bool:
    noise, rate = document.get("noise_per_grain"), document.get("frame_rate_hz")
    try:
        return (
            document.get("id") == certificate_id(document)
            and DIGEST.fullmatch(str(document.get("rig_digest"))) is not None
            and isinstance(document.get("cameras"), list)
            and isinstance(rate, int | float)
            and (noise is None or isinstance(noise, int | float))
        )
    except (ValueError, RecursionError, TypeError):
        return False
