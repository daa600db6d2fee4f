"""What a session did over time at some of its nodes, recorded or simulated."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Single
from zeromethod.loop.state import GOOD, State
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

MOST_NODES = 300
"""Nodes followed, evenly spread over the rest mask; fewer, `LEAST_NODES` at least, of long sessions."""

LEAST_NODES = 20
MOST_VALUES = 4_000_000
"""Nodes times frames: some 64 MB."""


@dataclass(frozen=True)
class TrackPoint:
    """One step. Times in s from the start of what is compared.

    moved: (nodes, 2) LCD px, where the mirror is by this frame alone, less the warp at rest; NaN where it
    could not be measured. behind: (nodes, 2) the warp that was shown less the one measured. sigma: rms noise
    of a component, LCD px. depth_error_um, peak_error_percent, true_peak_mm: against the mirror as it truly
    was, NaN where that is not known.
    """

    time_s: float
    state: State
    residual_rms_px: float
    moved: Single
    behind: Single
    sigma: float
    depth_peak_mm: float = float("nan")
    depth_error_um: float = float("nan")
    peak_error_percent: float = float("nan")
    true_peak_mm: float = float("nan")

    @property
    def nulled(self) -> bool:
        """Whether the loop said that readings count."""
        return self.state in GOOD


@dataclass
class Track:
    """Points of one session. name: how it is called in tables and pictures."""

    name: str
    points: list[TrackPoint] = field(default_factory=list)

    @property
    def time_s(self) -> Float:
        """(n,) s."""
        return np.array([point.time_s for point in self.points])

    @property
    def moved(self) -> Float:
        """(n, nodes, 2) LCD px."""
        return np.array([point.moved for point in self.points], dtype=np.float64)

    @property
    def behind(self) -> Float:
        """(n, nodes, 2) LCD px."""
        return np.array([point.behind for point in self.points], dtype=np.float64)

    def values(self, name: str) -> Float:
        """(n,) of one of the single figures of a point."""
        return np.array([getattr(point, name) for point in self.points], dtype=np.float64)


class FollowedNodes:
    """The nodes that are followed on one grid."""

    def __init__(self, rest: Rest, frames: int) -> None:
        """frames: about how many will be followed."""
        inner = np.zeros(rest.visible.shape, dtype=np.bool_)
        inner[rest.grid.inner] = True
        rows, cols = np.nonzero(rest.visible & inner)
        most = min(max(MOST_VALUES // max(frames, 1), LEAST_NODES), MOST_NODES)
        step = max(-(-rows.size // most), 1)
        self._rest = rest
        self._at = rows[::step], cols[::step]

    def pick(
        self, measured: Warp | None, shown_q: NDArray[np.floating] | None, zero: Float | None
    ) -> tuple[Single, Single, float]:
        """(moved, behind, sigma) of a `TrackPoint`. measured: from `zero` (None for rest)."""
        if measured is None or shown_q is None:
            nothing = np.full((self._at[0].size, 2), np.nan, np.float32)
            return nothing, nothing, float("nan")
        valid = measured.valid[self._at][:, None]
        q = measured.q[self._at] + (0.0 if zero is None else zero[self._at])
        moved = np.where(valid, q - self._rest.q[self._at], np.nan)
        behind = np.where(valid, shown_q[self._at] - q, np.nan)
        sigma = np.where(valid, measured.sigma[self._at], np.nan)
        known = sigma[np.isfinite(sigma)]
        noise = float(np.sqrt(np.mean(known**2))) if known.size else float("nan")
        return moved.astype(np.float32), behind.astype(np.float32), noise
