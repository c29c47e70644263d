"""Fault 20, where a URL leads: `judge` alone, with addresses that the test says. The rest is in test_20_webhooks.py."""

import socket
from collections.abc import Sequence

import pytest
from scanjobs.addresses import AddressRefused, judge

from tests.faults.private_addresses import NO_PLAIN_URLS


@pytest.mark.parametrize("url", NO_PLAIN_URLS, ids=lambda url: url[:40])
def test_what_is_no_plain_url_is_refused_wherever_it_leads(url: str) -> None:
    """Guard: `_parts`.

    Seen to fail: without each of its questions the URLs that it is for are followed: the characters and the length, the
    scheme and the host, the name and the fragment, the path in ASCII.
    """
    with pytest.raises(AddressRefused):
        judge(url, private_allowed=False, resolve=lambda *_: ["93.184.216.34"])


def test_one_private_address_among_public_ones_is_enough() -> None:
    """Guard: every address is judged. Seen to fail: with the first one judged alone the URL is followed."""
    with pytest.raises(AddressRefused):
        judge("https://example.org/", private_allowed=False, resolve=lambda *_: ["93.184.216.34", "10.0.0.7"])


def test_a_name_without_an_address_is_refused() -> None:
    """Guard: `OSError` in `judge`. Seen to fail: without it the resolver's `gaierror` comes out."""

    def nowhere(_: str, __: int) -> Sequence[str]:
        raise socket.gaierror("no")

    with pytest.raises(AddressRefused, match="no address"):
        judge("https://nowhere.example/", private_allowed=False, resolve=nowhere)
