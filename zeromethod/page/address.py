"""Addresses of the page and of the control socket, as they are typed."""

from __future__ import annotations

import re
from pathlib import Path

from zeromethod.errors import InputError

LOOPBACK = "127.0.0.1"
USUAL_PORT = 8470
"""Taken where it is free, so that the tunnel of yesterday serves today."""

_HOST_PORT = re.compile(r"(\[[0-9a-fA-F:]+\]|[\w.-]+):(\d{1,5})")
_ALLOWED = "HOST:PORT, such as 127.0.0.1:8470 (0.0.0.0:8470: from anywhere)"


def page_address(text: str) -> tuple[str, int]:
    """(host, port) of `--view`; port 0: any free one. Raises InputError, one line."""
    parts = _HOST_PORT.fullmatch(text)
    if parts is None or int(parts[2]) > 65535:
        raise InputError(f"--view: {text!r}: not an address: {_ALLOWED}")
    return parts[1].strip("[]"), int(parts[2])


def control_address(text: str) -> tuple[str, int] | str:
    """(host, port) of `--control tcp://HOST:PORT`, or the path of unix:PATH. Raises InputError."""
    if text.startswith("unix:"):
        path = Path(text.removeprefix("unix:")).absolute()
        if not path.parent.is_dir():
            raise InputError(f"--control: {text}: the folder {path.parent} does not exist")
        return str(path)
    parts = _HOST_PORT.fullmatch(text.removeprefix("tcp://"))
    if not text.startswith("tcp://") or parts is None or int(parts[2]) > 65535:
        raise InputError(f"--control: {text!r}: not an address: tcp://127.0.0.1:5557 or unix:PATH")
    return parts[1].strip("[]"), int(parts[2])


def shown(host: str, port: int) -> str:
    """HOST:PORT as it stands in a URL; from the machine itself where it is bound everywhere."""
    if host in {"0.0.0.0", "::", ""}:
        host = LOOPBACK
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
