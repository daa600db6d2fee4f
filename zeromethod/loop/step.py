"""What one turn of the loop leaves behind."""

from __future__ import annotations

from dataclasses import dataclass

from zeromethod.arrays import Float, Image
from zeromethod.loop.drawing import Drawn
from zeromethod.loop.events import Event
from zeromethod.loop.state import State
from zeromethod.sensing.residual import Residual
from zeromethod.warp.warp import Warp


@dataclass(frozen=True, slots=True)
class Step:
    """One turn of the loop. Arrays are the step's own and stay valid; None where there is nothing to tell.

    number: turns so far. time_ns: mid-exposure of the frame, else the time of the event.
    state, reason: the loop's state after the turn. events: what happened, by name.
    frame_number, dropped, exposure_ns, image: the frame as the camera gave it.
    held: corrections were held, or paused. sensed: the frame was fit to be looked at.
    presented: what was noted as shown since the step before; the first `presented_before` of them before this
    step's frame was looked at.
    residual: camera px. shown_q: (rows, cols, 2) the mix of warps that the frame saw, LCD px.
    notes: what the operator should know, one line each, told when it begins.
    measured: the warp by this frame alone, from the zero taken last (`Loop.rezero`); None when the frame must
    not be believed (then `events` says why; a part of it may still be right, but its peak need not be).
    commanded_q: (rows, cols, 2) what is to be shown next. filtered: the controller's own estimate, from the
    same zero. zero: (rows, cols, 2) LCD px, that zero less the rig's; None for 0.
    residual_rms_px: over valid nodes, camera px. valid_share: of the nodes seen at rest.
    loop_ms: frame in hand to command. draw_ms: to draw and present a command. delay_ms: from mid-exposure
    until the panel's middle row is half-way to the new picture; both NaN when none was presented. In real
    time they are those of the picture presented last, of an earlier frame.
    """

    number: int
    time_ns: int
    state: State
    reason: str
    events: tuple[Event, ...]
    commanded_q: Float
    filtered: Warp
    frame_number: int | None = None
    notes: tuple[str, ...] = ()
    dropped: int = 0
    exposure_ns: int = 0
    held: bool = False
    sensed: bool = False
    presented: tuple[Drawn, ...] = ()
    presented_before: int = 0
    zero: Float | None = None
    image: Image | None = None
    residual: Residual | None = None
    shown_q: Float | None = None
    measured: Warp | None = None
    residual_rms_px: float = float("nan")
    valid_share: float = 0.0
    loop_ms: float = float("nan")
    draw_ms: float = float("nan")
    delay_ms: float = float("nan")
