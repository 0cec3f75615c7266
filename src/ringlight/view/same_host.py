"""Which requests the viewer's server answers: those of pages that it served itself.

A browser lets any web page open a websocket to any host, and says in ``Origin`` which page it was. A page may also
have its own name point to this machine (DNS rebinding): then ``Host`` is that name. Both headers are looked at, of
plain requests too. Sources: RFC 6454 (Origin), RFC 6455 section 10.2 (websockets), RFC 9110 section 7.2 (Host).
"""

import ipaddress
import socket
from collections.abc import Sequence
from urllib.parse import SplitResult, urlsplit

LOOPBACK_NAME = "localhost"

SCHEMES = ("http", "https")
"""Of pages; https where somebody put a proxy with a certificate before the viewer."""


def refusal(hosts: Sequence[str], origins: Sequence[str], bound: str) -> str | None:
    """Why a request to a server that was bound to the address ``bound`` is not answered; None where it is.

    ``hosts`` and ``origins`` are the values of all headers of these names. A program that is no browser sends no
    ``Origin``, and is answered: it could do on this machine what it likes without the viewer.
    """
    if len(hosts) != 1 or len(origins) > 1:
        return "one Host header and at most one Origin header are answered"
    host = _split(f"//{hosts[0]}")
    if host is None or not _is_own(host.hostname or "", bound):
        return "this viewer answers to its own address only"
    if origins:
        origin = _split(origins[0])
        if origin is None or origin.scheme not in SCHEMES or _place(origin) != _place(host, origin.scheme):
            return "this viewer answers its own pages only"
    return None


def is_loopback(name: str) -> bool:
    """Whether only programs of this machine can reach a server that is bound to ``name``."""
    address = _address(name)
    return name.lower() == LOOPBACK_NAME or (address is not None and address.is_loopback)


def _is_own(name: str, bound: str) -> bool:
    """A name in somebody else's hands is what rebinding needs: addresses are nobody's."""
    if is_loopback(name) or name == bound.lower():
        return True
    if is_loopback(bound):
        return False
    return _address(name) is not None or name == socket.gethostname().lower()


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None


def _split(text: str) -> SplitResult | None:
    try:
        found = urlsplit(text)
        return found if found.port is None or found.port > 0 else None
    except ValueError:
        return None


def _place(of: SplitResult, scheme: str = "") -> tuple[str, int]:
    """Name and port, with the scheme's own port where none is said."""
    usual = {"http": 80, "https": 443}[of.scheme or scheme]
    return of.hostname or "", of.port or usual
