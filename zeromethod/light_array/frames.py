"""The frames on the link to real arrays, byte by byte, as the table in docs/leds.md has them."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from zeromethod.light_array.devices import Readings

LEVELS, READINGS = 1, 2
"""Kinds of frame: levels from host to arrays (`shown` and `time_ns` are 0), readings from arrays to host."""

_MAGIC, _VERSION = b"ZL", 1
_CONTENT = struct.Struct("<2sBBIIq512s")
"""Magic, version, kind, number, shown, time_ns (what counts are differences, so its sign does not matter),
256 values of 16 bits; a CRC-32 of all this follows."""

NUMBERS = 0xFFFFFFFF
"""Numbers have 32 bits, and begin again at 0."""

FRAME_BYTES = _CONTENT.size + 4


def frame(kind: int, of: Readings) -> bytes:
    """Frame of a kind; of levels: their number and, as counts, the levels (256,)."""
    number, shown = of.number & NUMBERS, of.shown & NUMBERS
    values = of.counts.astype("<u2").tobytes()
    content = _CONTENT.pack(_MAGIC, _VERSION, kind, number, shown, of.time_ns, values)
    return content + zlib.crc32(content).to_bytes(4, "little")


class Frames:
    """Finds frames of one kind in a stream of bytes. broken: how many began but had a wrong checksum."""

    def __init__(self, kind: int) -> None:
        self._begin, self._data, self.broken = bytes((*_MAGIC, _VERSION, kind)), b"", 0

    def add(self, data: bytes) -> list[Readings]:
        """Frames that are complete with these bytes."""
        self._data += data
        found: list[Readings] = []
        while (at := self._data.find(_MAGIC)) >= 0 and len(self._data) - at >= FRAME_BYTES:
            content, after = self._data[at : at + _CONTENT.size], at + FRAME_BYTES
            if not content.startswith(self._begin):
                after = at + len(_MAGIC)
            elif zlib.crc32(content).to_bytes(4, "little") != self._data[at + _CONTENT.size : after]:
                self.broken += 1
                after = at + len(_MAGIC)
            else:
                *_, number, shown, time_ns, values = _CONTENT.unpack(content)
                found.append(Readings(number, shown, time_ns, np.frombuffer(values, "<u2").astype(np.uint16)))
            self._data = self._data[after:]
        self._data = self._data[at:] if at >= 0 else self._data[-1:]
        return found
