"""Checksums that find arrays and rows of tables damaged on their disk.

The checksum of an item: its size in bytes, plus its bytes taken as little-endian 64-bit words (the remainder
as one more, filled up with zeros), modulo 2**64. It takes 0.1 ms for the 4 MB of a frame. Another content has
the same checksum with a chance of 1 in 2**64; zeros, the usual content of a lost block, have their size as
checksum, which nothing else is likely to have.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Image

UNCHECKED = frozenset({"checksum", "schema", "schema_version"})
"""Attributes of the root that are no part of its checksum: it, and those that are checked by themselves."""

CHECKSUMS = "checksums"
"""Dataset of a group with the checksums of all its others: row i of it, those of item i."""

_WORD = 8
_MODULO = 1 << 64


def checksum_of(item: memoryview | bytes | Image | np.generic) -> int:
    """Checksum of an item; see the module."""
    data = item.tobytes() if isinstance(item, np.ndarray | np.generic) else item
    count = len(data) // _WORD
    words = np.frombuffer(data, "<u8", count)
    rest = int.from_bytes(data[count * _WORD :], "little")
    return (len(data) + int(np.add.reduce(words)) + rest) % _MODULO


def canonical(attributes: Mapping[str, Any]) -> bytes:
    """Attributes of the root as the bytes that their checksum is of: HDF5 has none for their text."""
    checked = {name: value for name, value in attributes.items() if name not in UNCHECKED}
    return json.dumps(checked, sort_keys=True, default=lambda value: value.tolist()).encode()


def checksums_of(rows: Image) -> NDArray[np.uint64]:
    """(n,) checksums of the rows of a table (n,), all at once."""
    size = rows.dtype.itemsize
    padded = np.zeros((len(rows), -(-size // _WORD) * _WORD), np.uint8)
    padded[:, :size] = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), size)
    sums: NDArray[np.uint64] = padded.view("<u8").sum(axis=1, dtype=np.uint64) + np.uint64(size)
    return sums


class ChecksumRows:
    """Rows of the datasets `checksums`, made while the items of a group are added one by one."""

    def __init__(self, names: Sequence[str], fields: dict[str, tuple[str, ...]]) -> None:
        """names: of all datasets, by index. fields: of every dataset `checksums`, by its name."""
        index = {name: number for number, name in enumerate(names)}
        self._places: dict[int, tuple[int, int, int]] = {}
        for name, own in fields.items():
            group = name.rpartition("/")[0]
            for place, field in enumerate(own):
                self._places[index[f"{group}/{field}"]] = index[name], place, len(own)
        self._begun: dict[int, dict[int, int]] = {}

    def add(self, index: int, item: memoryview) -> tuple[int, bytes] | None:
        """Take in an item of the dataset of that index.

        Returns the index of a dataset `checksums` and its next row, once all items of a group are there.
        """
        if index not in self._places:
            return None
        checksums, place, count = self._places[index]
        begun = self._begun.setdefault(checksums, {})
        begun[place] = checksum_of(item)
        if len(begun) < count:
            return None
        del self._begun[checksums]
        return checksums, struct.pack(f"<{count}Q", *(begun[one] for one in range(count)))
