"""Frames over TCP as a raw video (y4m) that OpenCV, FFmpeg or a plain socket reads: newest only."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from contextlib import nullcontext
from fractions import Fraction

import numpy as np

from zeromethod.arrays import Image
from zeromethod.errors import InputError
from zeromethod.worker import Worker

POLL_S = 0.1
"""How long anything waits before it checks whether it is to end."""

SEND_BUFFER = 64 * 1024
"""Bytes that the system may buffer for the client: less than a frame, so that no frame waits there."""


def stream_header(columns: int, rows: int, rate_hz: float, bits: int) -> bytes:
    """First line of the stream: size, rate and "mono" (8 bits) or "mono16" (more: two bytes, low first)."""
    rate = Fraction(rate_hz).limit_denominator(1000)
    kind = "mono" if bits <= 8 else "mono16"
    return f"YUV4MPEG2 W{columns} H{rows} F{rate.numerator}:{rate.denominator} Ip A1:1 C{kind}\n".encode()


class FrameServer:
    """Serves frames to one client at a time on this machine's loopback.

    Each client gets the header, then a line FRAME and the pixels, row by row, of every frame that it has
    time for: while one is sent, one more waits, and a newer one replaces it. A new client is let in once the
    previous one has gone.
    """

    def __init__(self, port: int, header: bytes) -> None:
        """Listen on `port` (0: any free one); InputError when it is in use."""
        self._header = header
        self._client: socket.socket | None = None
        self._stop = threading.Event()
        self._socket = socket.socket()
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)
            self._socket.bind(("127.0.0.1", port))
            self._socket.listen(1)
        except OSError as error:
            self._socket.close()
            raise InputError(f"--port: {port}: {error.strerror or error}") from error
        self.port: int = self._socket.getsockname()[1]
        self._socket.setblocking(False)
        self._worker: Worker[bytes | None, None]
        self._worker = Worker("frame server", lambda: nullcontext(self._serve), idle=(POLL_S, None))

    @property
    def connected(self) -> bool:
        """Whether a client is there."""
        return self._client is not None

    def put(self, image: Image) -> bool:
        """Send a frame (rows, cols), uint8 or uint16, next; returns at once. False: nobody is there."""
        if not self.connected:
            return False
        little = image.astype(image.dtype.newbyteorder("<"), copy=False)
        self._worker.post(b"FRAME\n" + np.ascontiguousarray(little).tobytes())
        return True

    def close(self) -> None:
        """Disconnect the client and stop listening; safe to call twice."""
        self._stop.set()
        self._worker.close(1.0)
        self._disconnect()
        self._socket.close()

    def _serve(self, data: bytes | None) -> None:
        """Send a frame; without one, let a client in, or notice that it has gone."""
        try:
            if self._client is None:
                self._let_in()
            elif data is not None:
                self._send(self._client, data)
            elif _has_left(self._client):
                self._disconnect()
        except OSError:  # a client that has gone shows as an error of some kind; the next one is welcome
            self._disconnect()

    def _let_in(self) -> None:
        if select.select([self._socket], [], [], 0.0)[0]:
            self._client, _ = self._socket.accept()
            self._client.settimeout(POLL_S)
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._send(self._client, self._header)

    def _disconnect(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.close()

    def _send(self, client: socket.socket, data: bytes) -> None:
        left = memoryview(data)
        while left and not self._stop.is_set():
            with contextlib.suppress(TimeoutError):
                left = left[client.send(left) :]


def _has_left(client: socket.socket) -> bool:
    """Whether the client has closed its end; it sends nothing otherwise."""
    return bool(select.select([client], [], [], 0.0)[0]) and client.recv(1024) == b""
