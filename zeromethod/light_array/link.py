"""Real arrays, by UDP or a serial line, which set the pace: frames of `frames.py` both ways."""

from __future__ import annotations

import os
import re
import select
import socket
import termios
import time
import tty
from collections import deque
from contextlib import suppress

from zeromethod.errors import InputError
from zeromethod.light_array.devices import ArraysLost, Counts, LightArrays, Readings
from zeromethod.light_array.frames import LEVELS, READINGS, Frames, frame

_ADDRESS = re.compile(r"udp://(?P<host>\[[^\]]+\]|[^:/\[\]]+):(?P<port>\d{1,5})|serial://(?P<path>/.+)")
ALLOWED = '"simulated", udp://HOST:PORT, or serial:///dev/NAME'
_RECEIVE_BUFFER_BYTES = 1 << 21
_MOST_AT_ONCE = 1 << 16
_WAITING = 5
"""How many readings wait where the host is late: older ones are lost, which the gap in the numbers shows."""


class LinkedArrays(LightArrays):
    """Arrays at an address. Raises InputError where it is none, or cannot be opened."""

    def __init__(self, address: str) -> None:
        found = _ADDRESS.fullmatch(address)
        if found is None or not 0 < int(found["port"] or 1) < 65536:
            raise InputError(f"arrays.address: {address!r}: allowed: {ALLOWED}")
        self._host, self._port, self._path = found.group("host", "port", "path")
        self._handle = -1
        self._frames, self._waiting = Frames(READINGS), deque[Readings](maxlen=_WAITING)
        try:
            self._open()
        except OSError as error:
            why = error.strerror or error
            raise InputError(f"arrays.address: {address!r}: cannot be opened: {why}") from None

    def _open(self) -> None:
        self.close()
        if self._path is None:
            host, port = self._host.strip("[]"), int(self._port)
            family, kind, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
            with socket.socket(family, kind) as one:
                one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
                one.connect(where)
                one.setblocking(False)
                self._handle = one.detach()
            return
        self._handle = os.open(self._path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            tty.setraw(self._handle)
        except termios.error:
            self.close()
            raise OSError(f"{self._path} is no serial line") from None

    def send(self, number: int, levels: Counts) -> None:
        """Send levels. Raises ArraysLost.

        Where the other end takes nothing, the rest of the frame is left out, which its checksum shows there.
        """
        left = frame(LEVELS, Readings(number, 0, 0, levels))
        try:
            while left and select.select([], [self._handle], [], 0.05)[1]:
                left = left[os.write(self._handle, left) :]
        except (ConnectionRefusedError, BlockingIOError):
            pass  # nobody listens there yet, or takes it: no readings come either, and the state says so
        except OSError as error:
            raise ArraysLost(error.strerror or str(error)) from None

    def receive(self, timeout_s: float) -> Readings | None:
        """Return the next readings, None where none came in time. Raises ArraysLost."""
        try:
            while not self._waiting:
                if not select.select([self._handle], [], [], timeout_s)[0]:
                    return None
                self._read_all()
        except ConnectionRefusedError:  # nobody listens there yet
            time.sleep(timeout_s)
            return None
        except (OSError, ValueError) as error:
            raise ArraysLost(getattr(error, "strerror", None) or str(error)) from None
        return self._waiting.popleft()

    def _read_all(self) -> None:
        """Take all bytes that have come: a read of a socket gives one packet, of a line what is there."""
        with suppress(BlockingIOError):  # that was all
            while True:
                data = os.read(self._handle, _MOST_AT_ONCE)
                if not data and self._path is not None:
                    raise OSError("the serial line was closed")
                self._waiting.extend(self._frames.add(data))
                self.broken = self._frames.broken

    def reopen(self) -> bool:
        """Try once to open lost arrays again; whether they are open."""
        try:
            self._open()
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close socket or line."""
        if self._handle >= 0:
            os.close(self._handle)
        self._handle = -1
