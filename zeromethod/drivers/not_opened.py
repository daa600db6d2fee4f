"""Why a camera, stream or file could not be opened, in words: libraries say only that it could not."""

from __future__ import annotations

import errno
import os
import socket
from pathlib import Path
from urllib.parse import urlsplit

_PORTS = {"http": 80, "https": 443, "rtsp": 554, "rtmp": 1935}
_WAIT_S = 1.0


def reason(source: int | str) -> str:
    """Reason for a source of an OpenCV camera (index, URL or path), by looking again by other means."""
    if isinstance(source, int):
        return _file_reason(Path(f"/dev/video{source}"), "not a camera that gives pictures, or in use")
    if "://" in source:
        return _url_reason(source)
    return _file_reason(Path(source), "not a video file")


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
