"""Memory that two processes share: what is put in first is taken out first."""

from __future__ import annotations

import mmap
import os
from collections import deque

ALIGNED = 64
"""Items begin at multiples of so many bytes."""


def aligned(size: int) -> int:
    """Size with what lies between it and the next item."""
    return -(-size // ALIGNED) * ALIGNED


class Ring:
    """The sender's side. While the receiver keeps up, the same few pages are used again and again."""

    def __init__(self, size: int) -> None:
        self.handle = os.memfd_create("zeromethod recording")
        os.ftruncate(self.handle, size)
        self.memory = mmap.mmap(self.handle, size)
        self._size = size
        self._used: deque[tuple[int, int]] = deque()

    def take(self, size: int) -> int | None:
        """Offset of free memory of that size, in use from now on; None where there is none yet."""
        start = self._free(size)
        if start is not None:
            self._used.append((start, start + size))
        return start

    def _free(self, size: int) -> int | None:
        if not self._used:
            return 0 if size <= self._size else None
        first, (last, end) = self._used[0][0], self._used[-1]
        if last >= first and end + size <= self._size:
            return end
        start = 0 if last >= first else end
        # never up to the first byte in use: full would look like empty
        return start if start + size < first else None

    def release(self) -> None:
        """What was taken first is free again."""
        self._used.popleft()

    def close(self) -> None:
        """Let go of it; the receiver keeps its own side."""
        os.close(self.handle)
