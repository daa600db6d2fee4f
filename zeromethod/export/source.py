"""Which surfaces of a recording are exported: at the nodes, or on every pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Image
from zeromethod.errors import InputError
from zeromethod.fine.lattice import pixel_box
from zeromethod.fine.surface import FineSurface
from zeromethod.loop.state import State
from zeromethod.recording.recording import Recording
from zeromethod.surface import Surface


@dataclass(frozen=True, slots=True)
class MapSource:
    """Surfaces of a recording. fine: those of every pixel."""

    recording: Recording
    fine: bool = False

    @property
    def group(self) -> str:
        """Group of the recording that has them."""
        return "fine" if self.fine else "surface"

    @property
    def inner(self) -> tuple[slice, slice]:
        """Part of the maps that is exported: all but nodes that are never measured."""
        return (slice(None), slice(None)) if self.fine else self.recording.grid.inner

    @property
    def camera_px(self) -> tuple[Float, Float]:
        """Camera rows (v) and columns (u) of that part."""
        grid = self.recording.grid
        if not self.fine:
            return grid.v_px[grid.inner[0]], grid.u_px[grid.inner[1]]
        rows, cols = pixel_box(grid)
        return np.arange(rows.start, rows.stop, dtype=float), np.arange(cols.start, cols.stop, dtype=float)

    def read(self, step: int) -> Surface | FineSurface:
        """Surface of a step that has one. Raises InputError for a fine one that is damaged."""
        found = self.recording.fine(step) if self.fine else self.recording.surface(step)
        if found is None:
            raise InputError(f"{self.recording.path}: the fine surface of step {step} is damaged")
        return found

    def first(self, steps: list[int]) -> Surface | FineSurface:
        """The first of the steps' surfaces that is there and whole. Raises InputError where there is none."""
        for step in steps:
            if not self.recording.is_damaged(self.group, step) and step in self.numbers:
                return self.read(step)
        raise InputError(
            f"{self.recording.path}: no {self.group} surface was read in this time, or all are damaged"
        )

    @property
    def numbers(self) -> frozenset[int]:
        """Steps that have one."""
        return frozenset(self.recording.steps_with(self.group).tolist())

    def deepest(self, rows: Image) -> int | None:
        """Of some rows of the table of steps, the one with the peak of largest |depth|, locked if any is.

        A peak that is still being followed may lie in a hole. None where there is no peak.
        """
        recording = self.recording
        peaks = recording.fine_peaks if self.fine else recording.peaks
        peaks = peaks[np.isin(peaks["step"], rows["number"]) & np.isfinite(peaks["depth_mm"])]
        states = {int(row["number"]): recording.state_of(row) for row in rows}
        locked = [states[int(step)] is State.LOCKED for step in peaks["step"]]
        peaks = peaks[locked] if any(locked) else peaks
        return int(peaks["step"][np.argmax(np.abs(peaks["depth_mm"]))]) if len(peaks) else None
