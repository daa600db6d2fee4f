"""Messages between the run's process and the one that writes.

To the writer: lists of items whose bytes lie in shared memory. From the writer: `News`, a line of JSON each.
"""

from __future__ import annotations

import json
import os
import struct
from collections.abc import Sequence
from enum import IntEnum, StrEnum
from typing import NamedTuple

_HEAD = struct.Struct("<qI")
_ITEM = struct.Struct("<HBQQ")


class Write(IntEnum):
    """When an item is written."""

    ALWAYS = 0
    WITH_ROOM = 1
    """Only where there is room for all of the message's arrays."""
    WITHOUT_ROOM = 2
    """Only where there is none."""


class Item(NamedTuple):
    """dataset: its index among all. start, size: where its bytes lie."""

    dataset: int
    write: Write
    start: int
    size: int


class Message(NamedTuple):
    """time_ns: of the step that it is about. No items: the run is over."""

    time_ns: int
    items: list[Item]


class Topic(StrEnum):
    """What the writer reports."""

    READY = "ready"
    WRITTEN = "written"
    """One message was written."""
    FULL = "full"
    """There was no room for a message's arrays: text says how much it takes, frames how many were lost."""
    ROOM = "room"
    """There is room again."""
    FAILED = "failed"
    """Nothing more is written; text says why."""
    ASTRAY = "astray"
    """The file has no longer its name; text says where it is, "" for: it has it again."""
    CLOSED = "closed"


class News(NamedTuple):
    """A report of the writer. time_ns: of the step that it is about."""

    topic: Topic
    text: str = ""
    time_ns: int = 0
    frames: int = 0

    def encode(self) -> bytes:
        """One line."""
        return json.dumps(self).encode() + b"\n"

    @classmethod
    def decode(cls, line: bytes) -> News:
        """From one line."""
        topic, *rest = json.loads(line)
        return cls(Topic(topic), *rest)


def send(handle: int, time_ns: int, items: Sequence[Item]) -> None:
    """Write a message; waits until all of it was taken. Raises OSError when nobody reads any more."""
    left = memoryview(_HEAD.pack(time_ns, len(items)) + b"".join(_ITEM.pack(*item) for item in items))
    while left:
        left = left[os.write(handle, left) :]


def receive(handle: int) -> Message | None:
    """Next message; None when there are no more, or the sender ended in the middle of one."""
    head = _exactly(handle, _HEAD.size)
    if head is None:
        return None
    time_ns, count = _HEAD.unpack(head)
    listed = _exactly(handle, count * _ITEM.size)
    if listed is None:
        return None
    items = [Item(dataset, Write(write), *place) for dataset, write, *place in _ITEM.iter_unpack(listed)]
    return Message(time_ns, items)


def _exactly(handle: int, size: int) -> bytes | None:
    parts = b""
    while len(parts) < size:
        part = os.read(handle, size - len(parts))
        if not part:
            return None
        parts += part
    return parts
