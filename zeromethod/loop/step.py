"""The record that one step of the loop leaves: its figures, and with them its arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from zeromethod.approach.approach import Approach
from zeromethod.arrays import Float, Image
from zeromethod.contact import Contact, ContactFigures
from zeromethod.exposure.target_phase import TargetPhase
from zeromethod.fine.surface import FineSurface
from zeromethod.interactive.pointers import PointerEvent
from zeromethod.loop.call import Call
from zeromethod.loop.drawing import Drawn
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.rubbing import ContactStatus
from zeromethod.sensing.residual import Residual
from zeromethod.surface import Peak, Surface
from zeromethod.surface.comparison import Comparison
from zeromethod.warp.warp import Warp

NAN = float("nan")


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class StepFigures:
    """The figures of one step, without arrays.

    number: steps so far. time_ns: mid-exposure of the frame, else the time of the event. time_s: the same
    since the loop's first step. phase: part of a simulated scenario, "" where unknown.
    state, reason: the loop's state after the step. events: what happened, by name.
    notes: what the operator should know, one line each, when it begins. calls: of methods, that ended in it.
    frame_number, dropped, exposure_ns: the frame as the camera gave it; None, 0 and 0 for none.
    frozen: the command was kept on request, or paused. sensed: the frame was fit to be looked at.
    calibrated: the rig's geometry is known; without, depth is relative.
    residual_rms_px: over valid nodes, camera px. valid_share: of the nodes visible at rest.
    loop_ms: frame in hand to command. draw_ms: to draw and present a command. delay_ms: from mid-exposure
    until the panel's middle row is half-way to the new picture; both NaN when none was presented. In real
    time they are those of the picture presented last, of an earlier frame.
    peak, read_ms: deepest point of the surface read from this frame, and how long reading took; None and NaN
    where it was not read. readable: its surface was asked for. latency_ms: from mid-exposure until that was
    read and published, in real time; NaN in simulated time, which stands still meanwhile.
    touching: what touches the mirror in this frame, where it was read. total_force_n: sum of their forces, N,
    with its standard deviation; NaN where none is known.
    contact_status: of a texture that rubs along the mirror; None where none does or `control.rubbing` is off.
    approach: what a watch camera sees come; None for a rig without one, and for the step that ends a run.
    pointers: what fingers did, by the newest reading, on an interactive surface.
    truth: the reading compared with the true mirror of a simulated bench.
    untouched_rms_nm: rms depth (single frame, controller's filter) while nothing touches a simulated bench.
    """

    number: int
    time_ns: int
    time_s: float
    state: State
    reason: str = ""
    events: tuple[Event, ...] = ()
    notes: tuple[str, ...] = ()
    calls: tuple[Call, ...] = ()
    phase: str = ""
    frame_number: int | None = None
    dropped: int = 0
    exposure_ns: int = 0
    frozen: bool = False
    sensed: bool = False
    calibrated: bool = True
    residual_rms_px: float = NAN
    valid_share: float = 0.0
    loop_ms: float = NAN
    draw_ms: float = NAN
    delay_ms: float = NAN
    read_ms: float = NAN
    readable: bool = False
    latency_ms: float = NAN
    peak: Peak | None = None
    touching: tuple[ContactFigures, ...] = ()
    total_force_n: float = NAN
    sigma_total_force_n: float = NAN
    contact_status: ContactStatus | None = None
    approach: Approach | None = None
    pointers: tuple[PointerEvent, ...] = ()
    truth: Comparison | None = None
    untouched_rms_nm: tuple[float, float] | None = None

    @property
    def depth_peak_mm(self) -> float:
        """Depth of the peak, mm; NaN where the frame was not read."""
        return NAN if self.peak is None else self.peak.depth_mm

    @property
    def depth_peak_sigma_mm(self) -> float:
        """Standard deviation of the peak's depth, mm; NaN where the frame was not read."""
        return NAN if self.peak is None else self.peak.sigma_mm

    def __repr__(self) -> str:
        words = f"{type(self).__name__}({self.number}, {self.time_s:.3f} s, {self.state}: {self.reason}"
        if self.frame_number is not None:
            residual = (
                f"residual {self.residual_rms_px:.3g} px, " if math.isfinite(self.residual_rms_px) else ""
            )
            words += f", {residual}{100 * self.valid_share:.1f} % valid"
        if self.peak is not None:
            words += f", peak {1e3 * self.peak.depth_mm:.2f} µm"
        return words + ")"


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Step(StepFigures):
    """One step of the loop with its arrays, which are its own; None where there is nothing to report.

    image: (rows, cols) grey levels as the camera gave them. residual: camera px.
    shown: the mix of warps that the frame saw. target: known phase of a moving target in it. measured: the
    warp by this frame alone, from the zero taken last (`Loop.rezero`); None when the frame must not be
    believed (then `events` says why; a part of it may still be right, but its peak need not be). commanded:
    what is to be shown next. filtered: the controller's own estimate, from the same zero. zero: (rows, cols,
    2) LCD px, that zero less the rig's; None for 0. surface: slope and depth read from `measured`. contacts:
    what touches, as `touching`, with borders. fine: slope and depth on every pixel, from the last frames, now
    and then. presented: what was noted as presented since the step before; the first `presented_before` of
    them before this step's frame was looked at.
    """

    commanded: Warp
    filtered: Warp
    image: Image | None = None
    residual: Residual | None = None
    shown: Warp | None = None
    target: TargetPhase | None = None
    measured: Warp | None = None
    zero: Float | None = None
    surface: Surface | None = None
    contacts: tuple[Contact, ...] = ()
    fine: FineSurface | None = None
    presented: tuple[Drawn, ...] = ()
    presented_before: int = 0

    @property
    def figures(self) -> StepFigures:
        """The same step without its arrays."""
        return StepFigures(**{field.name: getattr(self, field.name) for field in fields(StepFigures)})
