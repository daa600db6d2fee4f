"""What goes from the run's process to the one that writes: a list of items whose bytes lie in shared memory.

Items are of one of three kinds: to be written always, only where there is room for all of the message's
arrays, or only where there is none.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Sequence
from typing import NamedTuple

ALWAYS, WITH_ROOM, WITHOUT_ROOM = range(3)

_HEAD = struct.Struct("<qI")
_ITEM = struct.Struct("<HBQQ")


class Item(NamedTuple):
    """dataset: its index among all. kind: see the module. start, size: where its bytes lie."""

    dataset: int
    kind: int
    start: int
    size: int


class Message(NamedTuple):
    """time_ns: of the turn that it is about. No items: the run is over."""

    time_ns: int
    items: list[Item]


def send(handle: int, time_ns: int, items: Sequence[Item]) -> None:
    """Write a message; waits until all of it was taken. Raises OSError when nobody reads any more."""
    left = memoryview(_HEAD.pack(time_ns, len(items)) + b"".join(_ITEM.pack(*item) for item in items))
    while left:
        left = left[os.write(handle, left) :]


def receive(handle: int) -> Message | None:
    """Next message; None when there are no more, or the sender went away in the middle of one."""
    head = _exactly(handle, _HEAD.size)
    if head is None:
        return None
    time_ns, count = _HEAD.unpack(head)
    listed = _exactly(handle, count * _ITEM.size)
    if listed is None:
        return None
    return Message(time_ns, [Item(*values) for values in _ITEM.iter_unpack(listed)])


def _exactly(handle: int, size: int) -> bytes | None:
    parts = b""
    while len(parts) < size:
        part = os.read(handle, size - len(parts))
        if not part:
            return None
        parts += part
    return parts
