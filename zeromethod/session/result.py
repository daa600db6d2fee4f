"""What a run leaves behind: every frame's figures, the frames that a picture shows, counts."""

from __future__ import annotations

from dataclasses import dataclass, field

from zeromethod.arrays import Float, Image
from zeromethod.control.stability_margin import Margin
from zeromethod.loop.state import State
from zeromethod.rig.model import Rig
from zeromethod.session.truth import Comparison
from zeromethod.surface import Surface

KEPT_FRAMES = 50_000
"""Frames whose figures a run keeps at least: a quarter of an hour at 60 per second, in some 40 MB."""


@dataclass(frozen=True)
class FrameRecord:
    """One frame's figures. Times in s from the first frame; `phase` is the scenario's, "" where unknown.

    depth_peak_mm, depth_peak_sigma_mm, read_ms: NaN where the frame was not read. In real time the surface is
    read beside the loop, newest frame only: a record gets its depth later, in `RunResult.records`, or never.
    newest_peak_mm: of the newest reading at hand at the time. notes: what the operator should know.
    """

    number: int
    time_s: float
    phase: str
    state: State
    reason: str
    events: tuple[str, ...]
    notes: tuple[str, ...]
    dropped: int
    residual_rms_px: float
    valid_share: float
    depth_peak_mm: float
    depth_peak_sigma_mm: float
    newest_peak_mm: float
    loop_ms: float
    draw_ms: float
    read_ms: float
    truth: Comparison | None
    untouched_rms_nm: tuple[float, float] | None
    """Depth rms (single frame, controller's filter) while nothing touches; truth known to be zero."""


@dataclass(frozen=True)
class Snapshot:
    """Everything about one frame that a picture of it needs; warps as displacement from rest, LCD px."""

    time_s: float
    image: Image
    residual_px: Float
    applied_px: Float
    measured_px: Float
    surface: Surface
    true_depth_mm: Float | None


@dataclass
class RunResult:
    """What a run leaves behind. dropped_refreshes: None where the display does not count them."""

    rig: Rig
    gl_renderer: str
    usable_share_at_rest: float
    """Share of the measurable nodes that the rig file says are usable while nothing presses."""
    records: list[FrameRecord] = field(default_factory=list)
    """Of the last `KEPT_FRAMES` frames at least; a run may go on for days."""
    frames: int = 0
    dropped: int = 0
    events: dict[str, int] = field(default_factory=dict)
    before: Snapshot | None = None
    pressed: Snapshot | None = None
    nulled: Snapshot | None = None
    interrupted: bool = False
    recording: str = ""
    """What went wrong with the recording; "" where all was kept, or none was asked for."""
    notes: list[str] = field(default_factory=list)
    dropped_refreshes: int | None = None
    margin: Margin | None = None
    """Stability at the delay that coded strips told when it was first known; None without."""
    delay_ms: float | None = None
    """Delay of display and camera as coded strips tell it (`DisplaySpec.latency_s`); None without."""

    def add(self, record: FrameRecord) -> None:
        """Take in one frame."""
        self.frames += 1
        self.dropped += record.dropped
        for event in record.events:
            self.events[event] = self.events.get(event, 0) + 1
        self.records.append(record)
        if len(self.records) >= 2 * KEPT_FRAMES:
            del self.records[:KEPT_FRAMES]

    @property
    def last(self) -> FrameRecord | None:
        """How it stood before the run was stopped; None before any turn."""
        told = (record for record in reversed(self.records) if record.state is not State.STOPPED)
        return next(told, self.records[-1] if self.records else None)

    @property
    def state(self) -> State:
        """State at the end of the run, before it was stopped."""
        return self.last.state if self.last is not None else State.STARTING
