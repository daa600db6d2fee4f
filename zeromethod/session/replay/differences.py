"""What a replay with other settings changed: bit for bit whether anything, and by how much."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float, Image
from zeromethod.recording.recording import Recording
from zeromethod.surface import Peak, Surface, Where

Figures = dict[str, Any]

_ARRAYS = ("depth_mm", "slope", "points_mm", "sigma_depth_mm", "sigma_slope", "valid", "contact")


def same(recorded: Image, replayed: Image) -> bool:
    """Whether both have the same bits at the recorded precision; NaN equals NaN."""
    if recorded.shape != replayed.shape:
        return False
    if recorded.dtype.kind != "f":
        return bool(np.array_equal(recorded, replayed))
    return bool(np.array_equal(recorded, replayed.astype(recorded.dtype), equal_nan=True))


@dataclass
class Spread:
    """Differences of one kind. unit: factor of the numbers in `figures`."""

    unit: float = 1.0
    largest: float = 0.0
    _square: float = 0.0
    _count: int = 0

    def add(self, difference: NDArray[np.floating] | float) -> None:
        """Take in differences; what is not finite does not count."""
        values = np.atleast_1d(np.asarray(difference, dtype=np.float64))
        values = values[np.isfinite(values)]
        if values.size:
            self.largest = max(self.largest, float(np.abs(values).max()))
            self._square += float((values**2).sum())
            self._count += values.size

    @property
    def figures(self) -> Figures:
        """Rms and largest; None where nothing could be compared."""
        if not self._count:
            return {"rms": None, "largest": None}
        return {
            "rms": self.unit * float(np.sqrt(self._square / self._count)),
            "largest": self.unit * self.largest,
        }


@dataclass
class DepthDifferences:
    """Replayed readings against recorded ones, step by step. Times in s from the recording's first frame.

    readings_damaged: those whose warp is damaged. surfaces_damaged: recorded ones that are damaged, of which
    only the peak is compared.
    """

    recording: Recording
    start_ns: int
    steps: int = 0
    readings_damaged: int = 0
    surfaces_damaged: int = 0
    different: list[int] = field(default_factory=list)
    time_s: list[float] = field(default_factory=list)
    recorded_mm: list[float] = field(default_factory=list)
    replayed_mm: list[float] = field(default_factory=list)
    rms_nm: list[float | None] = field(default_factory=list)
    depth: Spread = field(default_factory=lambda: Spread(1e6))
    peak: Spread = field(default_factory=lambda: Spread(1e6))
    valid: list[tuple[float, float]] = field(default_factory=list)

    def add(self, step: int, surface: Surface, peak: Peak) -> None:
        """Take in one reading."""
        row = self.recording.peaks[self.recording.peaks["step"] == step][0]
        names = ("depth_mm", "x_mm", "y_mm", "depth_sigma_mm", "possibly_deeper_mm")
        depth_mm, x_mm, y_mm, sigma_mm, deeper_mm = (float(row[name]) for name in names)
        known = Peak(depth_mm, x_mm, y_mm, sigma_mm, deeper_mm)
        recorded = self._recorded(step)
        # the depth inside a contact comes from pictures, which are not looked at again; so does what sigma
        # has of a tip beside a peak
        carried, told = row["where"] == Where.INSIDE, 3 if row["where"] == Where.BESIDE else 4
        equal = bool(carried) or same(_numbers(known)[:told], _numbers(peak)[:told])
        spread = Spread(1e6)
        if recorded is not None:
            equal = equal and same_surface(recorded, surface)
            difference = surface.depth_mm.astype(np.float32) - recorded.depth_mm
            self.depth.add(difference)
            spread.add(difference)
            inner = self.recording.grid.inner
            self.valid.append((float(recorded.valid[inner].mean()), float(surface.valid[inner].mean())))
        self.steps += 1
        if not equal:
            self.different.append(step)
        if not carried:
            self.peak.add(peak.depth_mm - known.depth_mm)
        self.time_s.append(1e-9 * (surface.time_ns - self.start_ns))
        self.recorded_mm.append(known.depth_mm)
        self.replayed_mm.append(peak.depth_mm)
        self.rms_nm.append(spread.figures["rms"])

    def _recorded(self, step: int) -> Surface | None:
        """The recorded surface; None where there is none, or where it is damaged, which is counted."""
        found = self.recording.surface(step)
        if found is not None and not found.valid.any() and self.recording.is_damaged("surface", step):
            self.surfaces_damaged += 1
            return None
        return found

    @property
    def figures(self) -> Figures:
        """JSON-ready. Differences of depth in nm; `depth_difference_rms_nm`: over all nodes, by reading."""
        valid = np.mean(self.valid, axis=0).tolist() if self.valid else (None, None)
        return {
            "readings": self.steps,
            "readings_equal": self.steps - len(self.different),
            "readings_damaged": self.readings_damaged,
            "surfaces_damaged": self.surfaces_damaged,
            "first_different_step": self.different[0] if self.different else None,
            "depth_difference_nm": self.depth.figures,
            "depth_difference_rms_nm": self.rms_nm,
            "peak_difference_nm": self.peak.figures,
            "read_share": {"recorded": valid[0], "replayed": valid[1]},
            "peaks": {
                "time_s": self.time_s,
                "recorded_mm": self.recorded_mm,
                "replayed_mm": self.replayed_mm,
            },
        }


def _numbers(peak: Peak) -> Float:
    return np.array([peak.depth_mm, peak.x_mm, peak.y_mm, peak.sigma_mm])


def same_surface(recorded: Surface, replayed: Surface) -> bool:
    """Whether a surface is the recorded one, arrays in the single precision of recordings."""
    for name in _ARRAYS:
        known = getattr(recorded, name)
        if known.dtype.kind == "f":
            known = known.astype(np.float32)
        if not same(known, getattr(replayed, name)):
            return False
    a, b = recorded.anchor, replayed.anchor
    one, other = ((c.mode, c.sigma_mm, c.far_field_mm, c.learned_ns) for c in (a, b))
    iterations = recorded.iterations == replayed.iterations
    return one == other and iterations and same(a.mask, b.mask) and recorded.time_ns == replayed.time_ns
