"""What a replay with other settings changed: bit for bit whether anything, and by how much."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.recording.recording import Recording
from zeromethod.surface import Peak, Surface

Figures = dict[str, Any]

_ARRAYS = ("depth_mm", "slope", "x_mm", "y_mm", "sigma_depth_mm", "sigma_slope", "valid", "contact")


def same(recorded: NDArray[Any], again: NDArray[Any]) -> bool:
    """Whether both hold the same bits at the precision of a recording's; NaN equals NaN."""
    if recorded.shape != again.shape:
        return False
    if recorded.dtype.kind != "f":
        return bool(np.array_equal(recorded, again))
    return bool(np.array_equal(recorded, again.astype(recorded.dtype), equal_nan=True))


@dataclass
class Spread:
    """Differences of one kind, gathered. unit: what a number of `figures` is multiplied by."""

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
    """Readings again against those recorded, turn by turn. Times in s from the recording's first turn."""

    recording: Recording
    start_ns: int
    turns: int = 0
    different: list[int] = field(default_factory=list)
    time_s: list[float] = field(default_factory=list)
    recorded_mm: list[float] = field(default_factory=list)
    again_mm: list[float] = field(default_factory=list)
    difference_um: list[float] = field(default_factory=list)
    depth: Spread = field(default_factory=lambda: Spread(1e6))
    peak: Spread = field(default_factory=lambda: Spread(1e6))
    valid: list[tuple[float, float]] = field(default_factory=list)

    def add(self, turn: int, surface: Surface, peak: Peak) -> None:
        """Take in one reading."""
        row = self.recording.peaks[self.recording.peaks["turn"] == turn][0]
        known = Peak(*(float(row[one.name]) for one in fields(Peak)))
        recorded = self.recording.surface(turn)
        equal = same(_numbers(known), _numbers(peak))
        spread = Spread(1e3)
        if recorded is not None:
            equal = equal and same_surface(recorded, surface)
            difference = surface.depth_mm.astype(np.float32) - recorded.depth_mm
            self.depth.add(difference)
            spread.add(difference)
            inner = self.recording.grid.inner
            self.valid.append((float(recorded.valid[inner].mean()), float(surface.valid[inner].mean())))
        self.turns += 1
        if not equal:
            self.different.append(turn)
        self.peak.add(peak.depth_mm - known.depth_mm)
        self.time_s.append(1e-9 * (surface.time_ns - self.start_ns))
        self.recorded_mm.append(known.depth_mm)
        self.again_mm.append(peak.depth_mm)
        rms_um = spread.figures["rms"]
        self.difference_um.append(float("nan") if rms_um is None else rms_um)

    @property
    def figures(self) -> Figures:
        """JSON-ready. Differences of depth in nm."""
        valid = np.mean(self.valid, axis=0).tolist() if self.valid else (None, None)
        return {
            "readings": self.turns,
            "readings_equal": self.turns - len(self.different),
            "first_different_turn": self.different[0] if self.different else None,
            "depth_difference_nm": self.depth.figures,
            "peak_difference_nm": self.peak.figures,
            "read_share": {"recorded": valid[0], "again": valid[1]},
            "peaks": {
                "time_s": self.time_s,
                "recorded_mm": self.recorded_mm,
                "again_mm": self.again_mm,
                "difference_um": self.difference_um,
            },
        }


def _numbers(peak: Peak) -> NDArray[np.float64]:
    return np.array([peak.depth_mm, peak.x_mm, peak.y_mm, peak.sigma_mm])


def same_surface(recorded: Surface, again: Surface) -> bool:
    """Whether a surface is the recorded one, arrays at the single precision that recordings have."""
    for name in _ARRAYS:
        known = getattr(recorded, name)
        if known.dtype.kind == "f":
            known = known.astype(np.float32)
        if not same(known, getattr(again, name)):
            return False
    a, b = recorded.anchor, again.anchor
    same_anchor = (a.mode, a.sigma_mm, a.tail_mm) == (b.mode, b.sigma_mm, b.tail_mm)
    iterations = recorded.iterations == again.iterations
    return same_anchor and iterations and same(a.mask, b.mask) and recorded.time_ns == again.time_ns
