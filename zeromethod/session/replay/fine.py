"""Fine surfaces read again from the same recorded frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from zeromethod.fine.frames import FRAMES, FineFrame
from zeromethod.fine.surface import FineSurface
from zeromethod.loop.circle import FrameResult
from zeromethod.loop.events import Event
from zeromethod.optics import Optics
from zeromethod.recording.recording import Recording
from zeromethod.recording.rows import FINE_PIXELS
from zeromethod.rig.model import Rig
from zeromethod.session.fine import LastFrames, fine_frame, with_doubt
from zeromethod.session.replay.differences import Figures, Spread, same, same_surface
from zeromethod.session.zero_doubt import ZeroDoubt
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.warp import Warp

if TYPE_CHECKING:
    from zeromethod.fine.reader import FineReader


@dataclass
class FineDifferences:
    """Replayed fine surfaces against recorded ones.

    unread: not read again, as not all of their frames are in the recording. damaged: recorded ones of which
    only the peak is compared.
    """

    recording: Recording
    readings: int = 0
    unread: int = 0
    damaged: int = 0
    different: list[int] = field(default_factory=list)
    depth: Spread = field(default_factory=lambda: Spread(1e6))
    peak: Spread = field(default_factory=lambda: Spread(1e6))

    def add(self, step: int, surface: FineSurface) -> None:
        """Take in one fine surface."""
        self.readings += 1
        rows = self.recording.fine_peaks
        equal = True
        for row in rows[rows["step"] == step]:
            known = np.array([row[name] for name in ("depth_mm", "x_mm", "y_mm")])
            self.peak.add(surface.peak[0] - known[0])
            equal = same(known, np.array(surface.peak))
        recorded = self.recording.fine(step)
        if recorded is not None:
            self.depth.add(surface.depth_mm - recorded.depth_mm)
            names = (*FINE_PIXELS, "valid")
            equal &= all(same(getattr(recorded, name), getattr(surface, name)) for name in names)
            equal &= same_surface(recorded.coarse, surface.coarse)
        elif self.recording.is_damaged("fine", step) or self.recording.is_damaged("fine_nodes", step):
            self.damaged += 1
        if not equal:
            self.different.append(step)

    @property
    def figures(self) -> Figures:
        """JSON-ready; differences in nm. Empty where the recording has no fine surfaces."""
        if not self.readings + self.unread:
            return {}
        return {
            "fine_readings": self.readings,
            "fine_readings_equal": self.readings - len(self.different),
            "fine_readings_unread": self.unread,
            "fine_surfaces_damaged": self.damaged,
            "fine_depth_difference_nm": self.depth.figures,
            "fine_peak_difference_nm": self.peak.figures,
        }


class FineReplay:
    """Reads the fine surfaces of a recording again, in the same order, as its frames go by.

    Which frames a reading was made of follows from those that the steps before it had. rig: with which they
    are read. grid: the nodes, with their rays.
    """

    def __init__(self, recording: Recording, rig: Rig, grid: NodeGrid) -> None:
        self.differences = FineDifferences(recording)
        self._recording = recording
        peaks = recording.fine_peaks["step"].tolist()
        self._read = frozenset([*peaks, *recording.steps_with("fine").tolist()])
        self._zeros = recording.steps_with("zeros")
        self._frames, self._zero = LastFrames(), 0
        self._rig, self._grid = rig, grid
        self._doubt = ZeroDoubt(rig, recording.rest)
        self._reader: FineReader | None = None

    def add(self, row: Any, taken: FrameResult, measured: Warp | None, compare: bool) -> None:
        """Take in a step's frame, and read and compare the fine surface if it had one.

        measured: from the session's zero; None where the frame is not believed. compare: or only read, for
        what the reader keeps.
        """
        if not self._read:
            return
        step = int(row["number"])
        zero = int(np.count_nonzero(self._zeros <= step))
        burst = Event.BURST in self._recording.events_of(row)
        self._frames.add(int(row["time_ns"]), self._frame(step, taken, measured, burst), zero != self._zero)
        self._zero = zero
        if step not in self._read:
            return
        frames = self._frames.all
        if len(frames) < FRAMES:
            self.differences.unread += compare
            return
        from zeromethod.fine.reader import FineReader  # noqa: PLC0415 - only --fine needs it

        self._reader = self._reader or FineReader(self._rig, Optics(self._rig), self._grid)
        surface = self._reader.read(with_doubt(frames, self._recording.zero(step), self._doubt))
        if compare:
            self.differences.add(step, surface)

    def _frame(self, step: int, taken: FrameResult, measured: Warp | None, burst: bool) -> FineFrame | None:
        image, seen = self._recording.image(step), taken.observation
        if burst or image is None or seen is None or taken.residual is None or measured is None:
            return None
        # the circle uses these arrays for the next frame
        d, shown = taken.residual.d.copy(), seen.shown.q.copy()
        return fine_frame(image, d, shown, measured, seen.target)
