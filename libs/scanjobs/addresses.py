"""Which addresses of the network the service may be sent to by a stranger: those of the public internet.

A host is resolved here, every address it has is judged, and the connection is made to an address that was judged: a
name that means something else a moment later changes nothing. All spellings of loopback (`127.1`, `2130706433`,
`0x7f.1`, `[::ffff:127.0.0.1]`, `①②⑦.0.0.1`) are judged by what they resolve to, not by how they look.
"""

import ipaddress
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from nerfmodal.errors import InvalidInput

WHERE: Final = "/url"
PORTS: Final = {"http": 80, "https": 443}
LONGEST_URL: Final = 2000
TRANSLATED: Final = tuple(ipaddress.IPv6Network(net) for net in ("64:ff9b::/96", "64:ff9b:1::/48", "::/96"))
"""IPv6 that a gateway turns into IPv4, or that once was IPv4: the address inside is not where one looks."""
Address = ipaddress.IPv4Address | ipaddress.IPv6Address
Resolve = Callable[[str, int], Sequence[str]]


class AddressRefused(InvalidInput):
    """The address is not one of the public internet; use another one, or let the operator allow private ones."""

    code = "ADDRESS_REFUSED"


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """An address that was judged, and what is asked for there."""

    scheme: str
    host: str
    port: int
    path: str
    address: str

    @property
    def url(self) -> str:
        """With the judged address in the place of the name."""
        host = f"[{self.address}]" if ":" in self.address else self.address
        return f"{self.scheme}://{host}:{self.port}{self.path}"

    @property
    def host_header(self) -> str:
        """The name that was asked for."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return host if self.port == PORTS[self.scheme] else f"{host}:{self.port}"


def resolve(host: str, port: int) -> Sequence[str]:
    """Every address of a host, as the system finds them."""
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
    return tuple(dict.fromkeys(str(row[4][0]) for row in found))


def judge(url: str, *, private_allowed: bool, resolve: Resolve = resolve) -> Target:
    """Where a URL leads, if it may be followed.

    Raises
    ------
    AddressRefused
        It is no plain http(s) URL, its host has no address, or one of its addresses is not public.
    """
    scheme, host, port, path = _parts(url)
    try:
        addresses = resolve(host, port)
    except (OSError, UnicodeError) as error:
        raise _refused(f"the host '{host}' has no address.", "Check the name.") from error
    if not addresses:
        raise _refused(f"the host '{host}' has no address.", "Check the name.")
    for address in addresses:
        if not private_allowed and not is_public(address):
            hint = "Use a public address; the operator may set NERFMODAL_WEBHOOKS_TO_PRIVATE_ADDRESSES."
            raise _refused(f"the host '{host}' leads to an address that is not public.", hint)
    return Target(scheme=scheme, host=host, port=port, path=path, address=addresses[0])


def is_public(text: str) -> bool:
    """Whether an address, and every address hidden in it, is of the public internet."""
    try:
        address = ipaddress.ip_address(text.partition("%")[0])
    except ValueError:
        return False
    if any(isinstance(address, ipaddress.IPv6Address) and address in network for network in TRANSLATED):
        return False
    return "%" not in text and all(one.is_global and not one.is_multicast for one in (address, *_inside(address)))


def _inside(address: Address) -> list[Address]:
    """IPv4 addresses that an IPv6 address carries: mapped, 6to4, Teredo."""
    if isinstance(address, ipaddress.IPv4Address):
        return []
    teredo = address.teredo or ()
    return [one for one in (address.ipv4_mapped, address.sixtofour, *teredo) if one is not None]


def _parts(url: str) -> tuple[str, str, int, str]:
    if len(url) > LONGEST_URL or any(ord(char) <= 32 or char in "\\\x7f" for char in url):
        raise _refused("this is no URL.", "Write https://host/path.")
    try:
        split = urlsplit(url)
        port = split.port
    except ValueError as error:
        raise _refused("this is no URL.", "Write https://host/path.") from error
    if split.scheme not in PORTS or not split.hostname:
        raise _refused("only http and https are spoken.", "Write https://host/path.")
    if split.username is not None or split.password is not None or split.fragment:
        raise _refused("a URL with a name, a password or a fragment is not followed.", "Write https://host/path.")
    try:
        path = (split.path or "/") + (f"?{split.query}" if split.query else "")
        path.encode("ascii")
    except UnicodeEncodeError as error:
        raise _refused("the path has characters that a URL cannot have.", "Percent-encode them.") from error
    return split.scheme, split.hostname, PORTS[split.scheme] if port is None else port, path


def _refused(message: str, hint: str) -> AddressRefused:
    return AddressRefused(message, where=WHERE, hint=hint)
