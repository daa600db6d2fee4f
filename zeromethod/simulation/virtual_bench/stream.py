"""Frames over TCP as a raw video (y4m) that OpenCV, FFmpeg or a plain socket reads: newest only."""

from __future__ import annotations

import contextlib
import select
import socket
import threading
from fractions import Fraction

import numpy as np

from zeromethod.arrays import Image
from zeromethod.errors import InputError

POLL_S = 0.1
"""How long anything waits before it looks whether it is to end."""

SEND_BUFFER = 64 * 1024
"""Bytes that the system may hold back for the client: less than a frame, so that none waits there."""


def stream_header(columns: int, rows: int, rate_hz: float, bits: int) -> bytes:
    """First line of the stream: size, rate and "mono" (8 bits) or "mono16" (more: two bytes, low first)."""
    rate = Fraction(rate_hz).limit_denominator(1000)
    kind = "mono" if bits <= 8 else "mono16"
    return f"YUV4MPEG2 W{columns} H{rows} F{rate.numerator}:{rate.denominator} Ip A1:1 C{kind}\n".encode()


class FrameServer:
    """Serves frames to one client at a time on this machine's loopback.

    Each client gets the header, then a line FRAME and the pixels, row by row, of every frame that it has
    time for: while one is sent, one more is kept, and a newer one takes its place. A new client is let in
    once the one before has gone.
    """

    def __init__(self, port: int, header: bytes) -> None:
        """Listen on `port` (0: any free one); InputError when it is in use."""
        self._header = header
        self._changed = threading.Condition()
        self._waiting: bytes | None = None
        self._connected = False
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
        self._socket.settimeout(POLL_S)
        self._thread = threading.Thread(target=self._serve, name="frame server", daemon=True)
        self._thread.start()

    @property
    def connected(self) -> bool:
        """Whether a client is there."""
        return self._connected

    def put(self, image: Image) -> bool:
        """Hand over a frame (rows, cols), uint8 or uint16; never waits. False: nobody is there."""
        little = image.astype(image.dtype.newbyteorder("<"), copy=False)
        data = b"FRAME\n" + np.ascontiguousarray(little).tobytes()
        with self._changed:
            if not self._connected:
                return False
            self._waiting = data
            self._changed.notify()
            return True

    def close(self) -> None:
        """Send the client away and stop listening; safe to call twice."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()
        self._thread.join(1.0)
        self._socket.close()

    def _serve(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._socket.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            # a client that has gone shows as an error of some kind; the next one is welcome
            with client, contextlib.suppress(OSError):
                client.settimeout(POLL_S)
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                with self._changed:
                    self._connected = True
                self._feed(client)
            with self._changed:
                self._connected = False
                self._waiting = None

    def _feed(self, client: socket.socket) -> None:
        """Send frames until the client has gone (OSError) or the server is to end."""
        self._send(client, self._header)
        while not self._stop.is_set():
            with self._changed:
                self._changed.wait_for(lambda: self._waiting is not None or self._stop.is_set(), POLL_S)
                data, self._waiting = self._waiting, None
            if data is not None:
                self._send(client, data)
            elif _has_left(client):
                return

    def _send(self, client: socket.socket, data: bytes) -> None:
        left = memoryview(data)
        while left and not self._stop.is_set():
            with contextlib.suppress(TimeoutError):
                left = left[client.send(left) :]


def _has_left(client: socket.socket) -> bool:
    """Whether the client has closed its end (it has nothing to say otherwise)."""
    readable, _, _ = select.select([client], [], [], 0.0)
    return bool(readable) and client.recv(1024) == b""
