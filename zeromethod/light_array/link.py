"""Real arrays, by UDP or a serial line: frames of `light_array/frames.py` both ways; their clock leads."""

from __future__ import annotations

import os
import re
import select
import socket
import termios
import time
import tty
from collections import deque

from zeromethod.errors import InputError
from zeromethod.light_array.devices import ArraysLost, Counts, Readings
from zeromethod.light_array.frames import FRAME_BYTES, READINGS, Frames, levels_frame, unpacked

_UDP = re.compile(r"udp://(\[[^\]]+\]|[^:/\[\]]+):(\d{1,5})")
_SERIAL = re.compile(r"serial://(/.+)")
ALLOWED = '"simulated", udp://HOST:PORT, or serial:///dev/NAME'
_RECEIVE_BUFFER_BYTES = 1 << 21
_MOST_AT_ONCE = 1 << 16
_WAITING = 5
"""Newest readings that wait where the host is late: older ones are lost, as the gap in the numbers says."""


class LinkedArrays:
    """Arrays at an address. Frames that are broken on the way are counted in `refused` and dropped."""

    live = True

    def __init__(self, address: str) -> None:
        self.address, self.refused = address, 0
        udp, line = _UDP.fullmatch(address), _SERIAL.fullmatch(address)
        if udp is not None and 0 < int(udp[2]) < 65536:
            self._peer: tuple[str, int] | None = (udp[1].strip("[]"), int(udp[2]))
        elif line is not None:
            self._peer, self._path = None, line[1]
        else:
            raise InputError(f"arrays.address: {address!r}: allowed: {ALLOWED}")
        self._handle = -1
        self._socket: socket.socket | None = None
        self._frames, self._waiting = Frames(READINGS), deque[Readings](maxlen=_WAITING)
        try:
            self._open()
        except OSError as error:
            raise InputError(
                f"arrays.address: {address!r}: cannot be opened: {error.strerror or error}"
            ) from None

    def _open(self) -> None:
        self.close()
        if self._peer is not None:
            family, kind, _, _, where = socket.getaddrinfo(*self._peer, type=socket.SOCK_DGRAM)[0]
            self._socket = socket.socket(family, kind)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _RECEIVE_BUFFER_BYTES)
            self._socket.connect(where)
            self._handle = self._socket.fileno()
        else:
            self._handle = os.open(self._path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                tty.setraw(self._handle)
            except termios.error:
                self.close()
                raise OSError(f"{self._path} is no serial line") from None

    def send(self, number: int, levels: Counts) -> None:
        """Send levels. A line that is full takes none, which the next readings show. Raises ArraysLost."""
        frame = levels_frame(number, levels)
        try:
            if self._socket is not None:
                self._socket.send(frame)
            else:
                self._write(frame)
        except ConnectionRefusedError:
            pass  # nobody listens there yet: no readings come either, and the state says so
        except OSError as error:
            raise ArraysLost(error.strerror or str(error)) from None

    def _write(self, frame: bytes) -> None:
        while frame:
            if not select.select([], [self._handle], [], 0.05)[1]:
                return  # the other end takes nothing: the rest of this frame breaks, as its checksum says
            frame = frame[os.write(self._handle, frame) :]

    def receive(self, timeout_s: float) -> Readings | None:
        """Return the next readings, None where none came in time. Raises ArraysLost."""
        try:
            while not self._waiting:
                if not select.select([self._handle], [], [], timeout_s)[0]:
                    return None
                self._read()
        except ConnectionRefusedError:  # nobody listens there yet
            time.sleep(timeout_s)
            return None
        except (OSError, ValueError) as error:
            raise ArraysLost(getattr(error, "strerror", None) or str(error)) from None
        return self._waiting.popleft()

    def _read(self) -> None:
        """Take all that has come."""
        while self._socket is not None:
            try:
                found = unpacked(self._socket.recv(FRAME_BYTES + 1, socket.MSG_DONTWAIT), READINGS)
            except BlockingIOError:
                return
            if found is None:
                self.refused += 1
            else:
                self._waiting.append(found)
        while select.select([self._handle], [], [], 0)[0]:
            data = os.read(self._handle, _MOST_AT_ONCE)
            if not data:
                raise OSError("the serial line was closed")
            before = self._frames.broken
            self._waiting.extend(self._frames.add(data))
            self.refused += self._frames.broken - before

    def reopen(self) -> bool:
        """Try once to open what was lost."""
        try:
            self._open()
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close socket or line."""
        if self._socket is not None:
            self._socket.close()
        elif self._handle >= 0:
            os.close(self._handle)
        self._handle, self._socket = -1, None
