"""The record that one step of the loop leaves."""

from __future__ import annotations

from dataclasses import dataclass

from zeromethod.arrays import Float, Image
from zeromethod.loop.drawing import Drawn
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.sensing.residual import Residual
from zeromethod.warp.warp import Warp


@dataclass(frozen=True, slots=True, repr=False)
class Step:
    """One step of the loop. Arrays are the step's own and stay valid; None where there is nothing to report.

    number: steps so far. time_ns: mid-exposure of the frame, else the time of the event. time_s: the same
    since the loop's first step.
    state, reason: the loop's state after the step. events: what happened, by name.
    frame_number, dropped, exposure_ns, image: the frame as the camera gave it.
    frozen: the command was kept on request, or paused. sensed: the frame was fit to be looked at.
    presented: what was noted as presented since the step before; the first `presented_before` of them before
    this step's frame was looked at.
    residual: camera px. shown: the mix of warps that the frame saw.
    notes: what the operator should know, one line each, when it begins.
    measured: the warp by this frame alone, from the zero taken last (`Loop.rezero`); None when the frame must
    not be believed (then `events` says why; a part of it may still be right, but its peak need not be).
    commanded: what is to be shown next. filtered: the controller's own estimate, from the same zero.
    zero: (rows, cols, 2) LCD px, that zero less the rig's; None for 0.
    residual_rms_px: over valid nodes, camera px. valid_share: of the nodes visible at rest.
    loop_ms: frame in hand to command. draw_ms: to draw and present a command. delay_ms: from mid-exposure
    until the panel's middle row is half-way to the new picture; both NaN when none was presented. In real
    time they are those of the picture presented last, of an earlier frame.
    """

    number: int
    time_ns: int
    time_s: float
    state: State
    reason: str
    events: tuple[Event, ...]
    commanded: Warp
    filtered: Warp
    frame_number: int | None = None
    notes: tuple[str, ...] = ()
    dropped: int = 0
    exposure_ns: int = 0
    frozen: bool = False
    sensed: bool = False
    presented: tuple[Drawn, ...] = ()
    presented_before: int = 0
    zero: Float | None = None
    image: Image | None = None
    residual: Residual | None = None
    shown: Warp | None = None
    measured: Warp | None = None
    residual_rms_px: float = float("nan")
    valid_share: float = 0.0
    loop_ms: float = float("nan")
    draw_ms: float = float("nan")
    delay_ms: float = float("nan")

    def __repr__(self) -> str:
        figures = f"residual {self.residual_rms_px:.3g} px, {100 * self.valid_share:.1f} % of the nodes valid"
        return f"Step({self.number}, {self.time_s:.3f} s, {self.state}: {self.reason}; {figures})"
