"""The presentation log: which warp was presented on the panel, and when."""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float, Ints

CAPACITY = 64
"""Presentations that are kept: more than a second of them."""


class PresentationLog:
    """Ring buffer of the newest presentations; the oldest is overwritten, memory is allocated once.

    An entry is the presentation time in ns (see `DisplaySpec`: the panel's first row starts to change
    `latency_s` later), the warp drawn, (rows, cols, 2) LCD px, the mid-exposure of the newest frame that the
    warp was made from (None without one), the code of the strips drawn with it (None without), and the
    target's shift along u and v, periods (`zeromethod.pattern.stepping`).
    """

    def __init__(self, shape: tuple[int, int], capacity: int = CAPACITY) -> None:
        self._times_ns = np.zeros(capacity, dtype=np.int64)
        self._warps = np.zeros((capacity, *shape, 2))
        self._source_ns: list[int | None] = [None] * capacity
        self._codes = np.full(capacity, -1, dtype=np.int64)
        self._shifts = np.zeros((capacity, 2))
        self._count = 0

    def __len__(self) -> int:
        return min(self._count, len(self._times_ns))

    @property
    def complete(self) -> bool:
        """Whether nothing has been overwritten yet: the oldest entry is the first picture of the run."""
        return self._count <= len(self._times_ns)

    def record(
        self,
        time_ns: int,
        q: Float,
        source_ns: int | None = None,
        code: int | None = None,
        shift: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        """Add that `q` (copied), made from a frame of `source_ns`, was presented at `time_ns` with `code`.

        shift: of the target, periods. ValueError when `time_ns` is before the last entry's.
        """
        newest_ns = int(self._times_ns[(self._count - 1) % len(self._times_ns)])
        if self._count and time_ns < newest_ns:
            raise ValueError(f"presented at {time_ns} ns, before the picture at {newest_ns} ns")
        slot = self._count % len(self._times_ns)
        self._times_ns[slot] = time_ns
        self._warps[slot] = q
        self._source_ns[slot] = source_ns
        self._codes[slot] = -1 if code is None else code
        self._shifts[slot] = shift
        self._count += 1

    @property
    def buffer(self) -> Float:
        """(capacity, rows, cols, 2) all warps, indexed by `slots`; read only."""
        return self._warps

    def slots(self, index: Ints) -> Ints:
        """Indices into `buffer` of entries counted from the oldest, 0 <= index < len."""
        return (self._count - len(self) + index) % len(self._times_ns)

    def times_ns(self) -> Ints:
        """(len,) presentation times, ns, oldest first."""
        return self._times_ns[self.slots(np.arange(len(self)))]

    def codes(self) -> Ints:
        """(len,) codes, oldest first; -1 for none."""
        return self._codes[self.slots(np.arange(len(self)))]

    def shifts(self, index: Ints) -> Float:
        """(k, 2) shifts of the target, periods along u and v, of entries counted from the oldest."""
        return self._shifts[self.slots(index)]

    def warp(self, index: int) -> Float:
        """Warp (rows, cols, 2) of the entry counted from the oldest; a view, valid until overwritten."""
        view: Float = self._warps[int(self.slots(np.array(index)))]
        return view

    def source_ns(self, index: int) -> int | None:
        """Mid-exposure, ns, of the frame that the entry, counted from the oldest, was made from."""
        return self._source_ns[int(self.slots(np.array(index)))]
