"""Who may do what: tokens, and where a request comes from.

A page elsewhere in the same browser cannot reach this one: its Origin is another; and a name that was made to
point here does not help it, as only names of this machine, and addresses, are served.
"""

from __future__ import annotations

import enum
import hmac
import ipaddress
import socket
from urllib.parse import SplitResult, urlsplit

LOCAL_NAMES = frozenset({"localhost", "127.0.0.1", "::1"})


class Right(enum.Enum):
    """What a token allows."""

    NONE = 0
    VIEW = 1
    CONTROL = 2


class Access:
    """Judges requests. host: that the page is bound to. tokens: (control, viewing only)."""

    def __init__(self, host: str, tokens: tuple[str, str]) -> None:
        self._tokens = tokens
        self._local = host in LOCAL_NAMES
        self._names = LOCAL_NAMES | {host, socket.gethostname(), socket.getfqdn()}

    def right_of(self, token: str) -> Right:
        """What a token allows."""
        given = token.encode(errors="replace")
        may_control = hmac.compare_digest(given, self._tokens[0].encode())
        may_view = hmac.compare_digest(given, self._tokens[1].encode())
        return Right.CONTROL if may_control else Right.VIEW if may_view else Right.NONE

    def serves_host(self, host: str | None) -> bool:
        """Whether a Host header names this machine. Any port: a tunnel may end at another one."""
        name = _parts(f"//{host or ''}").hostname or ""
        if name in self._names:
            return True
        return not self._local and _is_address(name)

    @staticmethod
    def own_origin(origin: str | None, host: str | None) -> bool:
        """Whether a request comes from this page, or from no page at all."""
        if origin is None:
            return True
        parts = _parts(origin)
        return parts.scheme in {"http", "https"} and parts.netloc.lower() == (host or "").lower()


def _parts(url: str) -> SplitResult:
    """Parts of an URL; none where it is no URL."""
    try:
        return urlsplit(url)
    except ValueError:
        return SplitResult("", "", "", "", "")


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True
