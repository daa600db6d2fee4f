"""What a session leaves behind: every step's figures, the frames that a picture shows, counts."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field, replace
from typing import Any

from zeromethod.control.stability_margin import Margin
from zeromethod.fine.surface import FineSurface
from zeromethod.interactive.pointers import PointerEvent
from zeromethod.loop.state import READ, State
from zeromethod.loop.step import Step, StepFigures
from zeromethod.rig.model import Rig
from zeromethod.session.fine_figures import FineFigures
from zeromethod.surface.comparison import TruthSource
from zeromethod.warp.rest import Rest

KEPT_FRAMES = 50_000
"""Frames whose figures are kept at least: a quarter of an hour at 60 per second, in some 40 MB."""


@dataclass
class RunResult:
    """What a session leaves behind, of all its runs.

    Attributes
    ----------
    rig : Rig
        The bench.
    gl_renderer : str
        Name of what drew the pattern.
    usable_share_at_rest : float
        Share of the measurable nodes that the rig file says are usable while nothing presses.
    rest : Rest
        The warp of the untouched mirror.
    true_mirror : callable, optional
        The mirror at a time in ns, where the camera knows it.
    records : list of StepFigures
        Figures of the last `KEPT_FRAMES` steps at least; a run may go on for days. In real time a frame is
        read after its step: its record gets the peak then, or never.
    fine : list of FineFigures
        Figures of the fine surfaces that were read.
    frames, dropped, steps : int
        Frames that came, frames that the camera dropped, and steps of the loop, with and without a frame.
    events : dict
        How often each event happened.
    before, worst, nulled : Step, optional
        Steps that were read: before the contact, or the first; of the largest residual; the last of the hold,
        or the deepest where it was not nulled in a hold.
    every_pixel : FineSurface, optional
        The last fine surface of the hold, or of the run where there is no hold.
    interrupted : bool
        Whether the last run was ended early, by Ctrl-C or `Session.interrupt`.
    recording_trouble : str
        What went wrong with the recording; "" where all was kept, or none was asked for.
    recording_lost : bool
        Whether that was a full disk or another end of the recording before the run's.
    recording_astray : bool
        Whether another program moved, deleted, replaced or cut its file short.
    notes : list of str
        What the operator should know, one line each.
    dropped_refreshes : int, optional
        Refreshes that showed no new picture in time; None where the display does not count them.
    margin : Margin, optional
        Stability at the delay that coded strips reported when it was first known.
    delay_ms : float, optional
        Delay of display and camera as coded strips report it (`DisplaySpec.latency_s`).
    exposure : dict, optional
        What `run --auto-exposure` came to: `exposure_ms`, `changes`, `reason`.
    """

    rig: Rig
    gl_renderer: str
    usable_share_at_rest: float
    rest: Rest
    true_mirror: TruthSource | None = None
    records: list[StepFigures] = field(default_factory=list)
    fine: list[FineFigures] = field(default_factory=list)
    frames: int = 0
    steps: int = 0
    dropped: int = 0
    events: dict[str, int] = field(default_factory=dict)
    before: Step | None = None
    worst: Step | None = None
    nulled: Step | None = None
    every_pixel: FineSurface | None = None
    interrupted: bool = False
    recording_trouble: str = ""
    recording_lost: bool = False
    recording_astray: bool = False
    notes: list[str] = field(default_factory=list)
    dropped_refreshes: int | None = None
    margin: Margin | None = None
    delay_ms: float | None = None
    exposure: dict[str, Any] | None = None
    _worst_px: float = field(default=0.0, init=False)
    _deepest_mm: float = field(default=0.0, init=False)
    _held: bool = field(default=False, init=False)
    _newest: Step | None = field(default=None, init=False)

    def add(self, step: StepFigures) -> None:
        """Take in one step.

        Parameters
        ----------
        step : StepFigures
            Its figures.
        """
        self.steps += 1
        self.frames += step.frame_number is not None
        self.dropped += step.dropped
        self.notes += step.notes
        for event in step.events:
            self.events[event] = self.events.get(event, 0) + 1
        self.records.append(step)
        if len(self.records) >= 2 * KEPT_FRAMES:
            del self.records[:KEPT_FRAMES]

    def end(self, pointers: tuple[PointerEvent, ...]) -> None:
        """Enter what fingers did after the last step, up to the end of the run.

        Parameters
        ----------
        pointers : tuple of PointerEvent
            Events, in the order in which they came.
        """
        if pointers and self.records:
            self.records[-1] = replace(self.records[-1], pointers=self.records[-1].pointers + pointers)

    def keep(self, step: Step, phases: frozenset[str]) -> None:
        """Keep a step that was read if the figure shows it: before the contact, at its worst, or as read.

        Parameters
        ----------
        step : Step
            With its image, residual, warps and surface.
        phases : frozenset of str
            Parts of a simulated scenario; empty without one.
        """
        assert step.image is not None
        kept = replace(step, image=step.image.copy())
        self._newest = kept
        settled, in_hold = step.state in READ, step.phase == "hold"
        if settled and (step.phase == "untouched" if phases else self.before is None):
            self.before = kept
        # After the hold comes the lift, whose residual may be larger still; the figure shows the press.
        if self.before is not None and not self._held and step.residual_rms_px > self._worst_px:
            self._worst_px = step.residual_rms_px
            self.worst = kept
        # at rest the deepest is noise: the newest is shown
        deep_mm = 0.0 if step.state in {State.RESTING, State.APPROACH} else abs(step.depth_peak_mm)
        if settled and (in_hold or (not self._held and deep_mm >= self._deepest_mm)):
            self._deepest_mm = deep_mm
            self._held, self.nulled = in_hold, kept

    def keep_fine(self, step: Step, figures: FineFigures, phases: frozenset[str]) -> None:
        """Keep the figures of a step's fine surface, and the surface itself if the figure shows it.

        Parameters
        ----------
        step : Step
            With its fine surface.
        figures : FineFigures
            Of that surface.
        phases : frozenset of str
            Parts of a simulated scenario; empty without one.
        """
        self.fine.append(figures)
        if "hold" not in phases or step.phase == "hold":
            self.every_pixel = step.fine

    def enter(self, read: StepFigures) -> None:
        """Enter what was read from a frame into its record.

        Parameters
        ----------
        read : StepFigures
            Figures of the frame, with its peak.
        """
        index = bisect_left(self.records, read.number, key=lambda record: record.number)
        if index < len(self.records) and self.records[index].number == read.number:
            own = self.records[index]  # events are with the step that said them
            self.records[index] = replace(read, notes=own.notes, pointers=own.pointers)

    @property
    def start_ns(self) -> int:
        """Time of the first step, from which times in s count; 0 without a record."""
        return self.records[0].time_ns - round(1e9 * self.records[0].time_s) if self.records else 0

    @property
    def shown(self) -> Step | None:
        """Step whose maps the figure has: `nulled`, but the last one read of a run that ends *nulling*."""
        ends_unread = not self._held and self.state is State.NULLING
        return self._newest if ends_unread or self.nulled is None else self.nulled

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
