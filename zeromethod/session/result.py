"""What a session leaves behind: every step's figures, the frames that a picture shows, counts."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field, replace

from zeromethod.control.stability_margin import Margin
from zeromethod.loop.state import State
from zeromethod.loop.step import Step, StepFigures
from zeromethod.rig.model import Rig
from zeromethod.surface.comparison import TruthSource
from zeromethod.warp.rest import Rest

KEPT_FRAMES = 50_000
"""Frames whose figures are kept at least: a quarter of an hour at 60 per second, in some 40 MB."""


@dataclass
class RunResult:
    """What a session leaves behind. dropped_refreshes: None where the display does not count them.

    records: figures of the last `KEPT_FRAMES` steps at least; a run may go on for days. In real time a frame
    is read after its step: its record gets the peak then, or never. before, pressed, nulled: steps that the
    figure shows. true_mirror: the mirror at a time in ns, where the camera knows it.
    """

    rig: Rig
    gl_renderer: str
    usable_share_at_rest: float
    """Share of the measurable nodes that the rig file says are usable while nothing presses."""
    rest: Rest
    true_mirror: TruthSource | None = None
    records: list[StepFigures] = field(default_factory=list)
    frames: int = 0
    dropped: int = 0
    events: dict[str, int] = field(default_factory=dict)
    before: Step | None = None
    pressed: Step | None = None
    nulled: Step | None = None
    interrupted: bool = False
    recording: str = ""
    """What went wrong with the recording; "" where all was kept, or none was asked for."""
    notes: list[str] = field(default_factory=list)
    dropped_refreshes: int | None = None
    margin: Margin | None = None
    """Stability at the delay that coded strips reported when it was first known; None without."""
    delay_ms: float | None = None
    """Delay of display and camera as coded strips report it (`DisplaySpec.latency_s`); None without."""

    def add(self, step: StepFigures) -> None:
        """Take in one step."""
        self.frames += 1
        self.dropped += step.dropped
        self.notes += step.notes
        for event in step.events:
            self.events[event] = self.events.get(event, 0) + 1
        self.records.append(step)
        if len(self.records) >= 2 * KEPT_FRAMES:
            del self.records[:KEPT_FRAMES]

    def enter(self, read: StepFigures) -> None:
        """Enter what was read from a frame into its record."""
        index = bisect_left(self.records, read.number, key=lambda record: record.number)
        if index < len(self.records) and self.records[index].number == read.number:
            self.records[index] = replace(read, notes=self.records[index].notes)

    @property
    def last(self) -> StepFigures | None:
        """How it stood before the run was stopped; None before any step."""
        running = (record for record in reversed(self.records) if record.state is not State.STOPPED)
        return next(running, self.records[-1] if self.records else None)

    @property
    def state(self) -> State:
        """State at the end of the run, before it was stopped."""
        return self.last.state if self.last is not None else State.STARTING

    def __repr__(self) -> str:
        return f"RunResult({self.rig.name!r}, {self.frames} frames, {self.state})"
