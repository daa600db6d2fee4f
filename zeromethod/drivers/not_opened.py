"""Why a camera, stream or file could not be opened, in words: libraries say only that it could not."""

from __future__ import annotations

import contextlib
import errno
import os
import socket
from pathlib import Path
from urllib.parse import urlsplit

_PORTS = {"http": 80, "https": 443, "rtsp": 554, "rtmp": 1935}
_LOCAL = "/dev/video{}"
_WAIT_S = 1.0
_TAKEN = ("controlled by another", "exclusively", "busy", "access denied", "access-denied")
"""What Pylon and Aravis say of a camera that another program has."""


def reason(source: int | str) -> str:
    """Reason for a source of an OpenCV camera (index, URL or path), by looking again by other means."""
    if isinstance(source, int):
        path = Path(_LOCAL.format(source))
        users = _users_of(path)
        otherwise = (
            f"in use by {users}: end that first" if users else "not a camera that gives pictures, or in use"
        )
        return _file_reason(path, otherwise)
    if "://" in source:
        return _url_reason(source)
    return _file_reason(Path(source), "not a video file")


def _users_of(path: Path) -> str:
    """Other programs that have a device open, as far as this user may see them; "" for none."""
    found = []
    for link in Path("/proc").glob("[0-9]*/fd/*"):
        process = link.parts[2]
        with contextlib.suppress(OSError):
            if int(process) != os.getpid() and os.readlink(link) == str(path):
                name = Path("/proc", process, "comm").read_text(encoding="utf-8", errors="replace").strip()
                found.append(f"{name} (process {process})")
    return ", ".join(dict.fromkeys(found))


def in_words(message: str) -> str:
    """A camera library's message, after plain words where it means that another program has the camera."""
    taken = any(sign in message.lower() for sign in _TAKEN)
    return f"in use by another program: end that first ({message})" if taken else message


def _file_reason(path: Path, otherwise: str) -> str:
    try:
        os.close(os.open(path, os.O_RDONLY | os.O_NONBLOCK))
    except OSError as error:
        if error.errno == errno.EACCES and path.parent == Path("/dev"):
            return f"{path}: no permission: add yourself to the group video"
        return f"{path}: {(error.strerror or str(error)).lower()}"
    return f"{path}: {otherwise}"


def _url_reason(url: str) -> str:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port or _PORTS.get(parts.scheme.lower())
    except ValueError as error:
        return str(error)
    if host is None or port is None:
        return "host or port missing"
    if parts.scheme.lower() == "udp":
        return "no pictures come there"
    try:
        socket.create_connection((host, port), _WAIT_S).close()
    except OSError as error:
        return _no_connection(error, host, port)
    return f"{host} answers at port {port}, but sends no pictures in time that can be read"


def _no_connection(error: OSError, host: str, port: int) -> str:
    match error:
        case ConnectionRefusedError():
            return f"{host} refuses connections at port {port}: does the camera or server run?"
        case TimeoutError():
            return f"{host} does not answer at port {port} (timed out): address, cable, firewall"
        case socket.gaierror():
            return f"{host}: no such host"
        case _:
            return f"{host}, port {port}: {(error.strerror or str(error)).lower()}"
