"""The frames on the link to real arrays, byte by byte: docs/leds.md has the table.

Little-endian: "ZL", version 1, kind (1 levels, 2 readings), number (u32), shown (u32; 0 in levels), time_ns
(u64; 0 in levels), 256 values (u16), CRC-32 (u32) of all before it: 536 bytes.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np

from zeromethod.light_array.devices import Counts, Readings

LEVELS, READINGS = 1, 2
_MAGIC, _VERSION = b"ZL", 1
_HEAD = struct.Struct("<2sBBIIQ")
_CRC = struct.Struct("<I")
_VALUES = 256
FRAME_BYTES = _HEAD.size + 2 * _VALUES + _CRC.size


def levels_frame(number: int, levels: Counts) -> bytes:
    """Frame that asks for levels (256,)."""
    return _packed(LEVELS, number, 0, 0, levels)


def readings_frame(readings: Readings) -> bytes:
    """Frame of one reading of every detector."""
    return _packed(READINGS, readings.number, readings.shown, readings.time_ns, readings.counts)


def _packed(kind: int, number: int, shown: int, time_ns: int, values: Counts) -> bytes:
    head = _HEAD.pack(_MAGIC, _VERSION, kind, number & 0xFFFFFFFF, shown & 0xFFFFFFFF, time_ns)
    body = head + values.astype("<u2").tobytes()
    return body + _CRC.pack(zlib.crc32(body))


def unpacked(data: bytes, kind: int) -> Readings | None:
    """What a whole frame says, of levels without a time; None for one that is broken or of another kind."""
    if len(data) != FRAME_BYTES or _CRC.unpack(data[-_CRC.size :])[0] != zlib.crc32(data[: -_CRC.size]):
        return None
    magic, version, found, number, shown, time_ns = _HEAD.unpack(data[: _HEAD.size])
    if (magic, version, found) != (_MAGIC, _VERSION, kind):
        return None
    counts = np.frombuffer(data, "<u2", _VALUES, _HEAD.size).astype(np.uint16)
    return Readings(number, shown, time_ns, counts)


class Frames:
    """Frames out of a stream of bytes. broken: frames that began but did not hold."""

    def __init__(self, kind: int) -> None:
        self._kind, self._data, self.broken = kind, b"", 0

    def add(self, data: bytes) -> list[Readings]:
        """Frames that are whole with these bytes."""
        self._data += data
        found: list[Readings] = []
        while True:
            at = self._data.find(_MAGIC)
            if at < 0:
                self._data = self._data[-1:]
                return found
            if len(self._data) - at < FRAME_BYTES:
                self._data = self._data[at:]
                return found
            one = unpacked(self._data[at : at + FRAME_BYTES], self._kind)
            if one is None:
                self.broken += self._data[at + 2 : at + 4] == bytes((_VERSION, self._kind))
                self._data = self._data[at + 2 :]
            else:
                found.append(one)
                self._data = self._data[at + FRAME_BYTES :]
