"""What the loop is doing, in an operator's words.

    STARTING --usable frame--> NULLING --small residual in 3 frames--> LOCKED <--at rest?--> RESTING
                                  ^                                       |                     |
                                  +--------------- residual large --------+---------------------+

    LOCKED, RESTING --a watch camera sees something come--> APPROACH, and back when it touches or goes
    LOCKED, RESTING, APPROACH --nulled, but its readings must not be trusted--> UNCALIBRATED, MOVED, and back
    STARTING, PASSIVE, RESTING --of a pattern that is never warped--> PASSIVE <--at rest?--> RESTING
    any of these nine --no usable new information--> HOLDING (STARTING keeps its name; the warp stays)
    any of these ten    --most of the reflection gone--> COVERED; --few nodes still valid--> LOST
    any of these twelve --asked to pause--> PAUSED (frames are measured, the warp stays) until resumed
    any              --device lost, wrong frame, stalled--> FAULT
    HOLDING, COVERED, LOST, FAULT --usable frame--> any of NULLING ... MOVED, COVERED or LOST, by its figures
    any              --asked to stop--> STOPPED --run again--> STARTING

A refused frame neither counts as small nor breaks the row of small ones. FAULT, COVERED and LOST are not left
by holding. LOST, as a state, is the whole loop's; a single lost node is a flag of its warp.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass
from typing import NamedTuple

from zeromethod.loop.order_check import Order

LOCK_RESIDUAL_PX = 0.05
"""Residual rms over valid nodes, camera px, under which a frame counts as nulled."""

LOCK_FRAMES = 3
"""Consecutive nulled frames that make a lock."""

COVERED_FROM = 0.5
"""Share of the nodes visible at rest without light from which something covers the mirror."""

LOST_BELOW = 0.5
"""Share of the nodes usable at rest that must be valid, or the loop is lost."""


class State(enum.StrEnum):
    """The loop's state."""

    STARTING = "starting"
    RESTING = "resting"
    NULLING = "nulling"
    LOCKED = "locked"
    APPROACH = "approach"
    PASSIVE = "passive"
    UNCALIBRATED = "not calibrated"
    MOVED = "bench moved"
    COVERED = "covered"
    LOST = "lost"
    HOLDING = "holding"
    PAUSED = "paused"
    FAULT = "fault"
    STOPPED = "stopped"


NULLED = frozenset({State.LOCKED, State.RESTING, State.APPROACH})
"""States in which the camera sees the target: a reading of a held press counts."""

GOOD = NULLED | {State.PASSIVE}
"""States in which readings count: by the null, or by an open loop that is asked for."""

READ = GOOD | {State.UNCALIBRATED}
"""States in which depth can be read, if only as relative."""


def sees_target(state: State, residual_rms_px: float) -> bool:
    """Whether the camera saw the target in a frame, which may then teach what it looks like; also passive."""
    return state in READ and residual_rms_px < LOCK_RESIDUAL_PX


class Doubt(NamedTuple):
    """Why readings must not be trusted though the camera sees the target."""

    state: State
    """UNCALIBRATED or MOVED."""
    reason: str


class Outcome(enum.Enum):
    """Kinds of outcome of a step."""

    MEASURED = enum.auto()  # a frame was measured; the step's figures say how well
    HELD = enum.auto()  # nothing new that may be used
    PAUSED = enum.auto()  # a frame was measured, and corrections are to wait
    FAILED = enum.auto()  # a device is lost or gives what it must not
    STOP = enum.auto()  # the run ends


@dataclass(frozen=True, slots=True)
class StepOutcome:
    """What one step came to. The figures count only when it was measured; `reason` explains the others.

    order: of the carrier, known or not. unread: what is done about nodes that no picture can null. passive:
    the pattern is never warped, so that the residual is what is measured. coming: of what is about to touch.
    """

    outcome: Outcome
    reason: str = ""
    residual_rms_px: float = float("nan")
    valid_share: float = 0.0
    at_rest: bool = False
    covered_share: float = 0.0
    doubt: Doubt | None = None
    order: Order = Order.KNOWN
    unread: str = ""
    passive: bool = False
    coming: str = ""


@dataclass(frozen=True, slots=True)
class Status:
    """State, why, and how many consecutive measured frames were nulled."""

    state: State = State.STARTING
    reason: str = "waiting for the first frame"
    nulled_frames: int = 0

    @property
    def locks_next(self) -> bool:
        """Whether one more nulled frame makes, or keeps, a lock."""
        return self.nulled_frames + 1 >= LOCK_FRAMES


def next_status(previous: Status, step: StepOutcome) -> Status:
    """Status after a step; see the module's diagram."""
    state = previous.state
    if state is State.STOPPED:
        return previous
    match step.outcome:
        case Outcome.STOP:
            return Status(State.STOPPED, step.reason)
        case Outcome.FAILED:
            return Status(State.FAULT, step.reason)
        case Outcome.HELD:
            kept = state in {State.STARTING, State.COVERED, State.LOST, State.FAULT}
            return Status(state if kept else State.HOLDING, step.reason, previous.nulled_frames)
        case Outcome.PAUSED:
            return Status(State.PAUSED, step.reason, previous.nulled_frames)
        case Outcome.MEASURED:
            return _blind(step) or (_passive if step.passive else _nulled)(previous, step)


def _blind(step: StepOutcome) -> Status | None:
    """Status of a measured step that sees too little of the mirror, or not which part of the target."""
    if step.covered_share >= COVERED_FROM:
        return Status(State.COVERED, f"{100 * step.covered_share:.0f} % of the reflection is gone")
    if step.valid_share < LOST_BELOW:
        return Status(State.LOST, step.reason or f"{100 * step.valid_share:.0f} % of the nodes are seen")
    if step.unread:
        return Status(State.NULLING, step.unread)
    if step.order is not Order.KNOWN:
        return Status(State.LOST if step.order is Order.UNKNOWN else State.NULLING, step.order)
    return None


def _nulled(previous: Status, step: StepOutcome) -> Status:
    """Status of a measured step of a loop that nulls."""
    if not step.residual_rms_px < LOCK_RESIDUAL_PX:
        return Status(State.NULLING, f"residual {step.residual_rms_px:.3g} px")
    nulled = previous.nulled_frames + 1
    if nulled < LOCK_FRAMES:
        return Status(State.NULLING, f"nulled for {nulled} of {LOCK_FRAMES} frames", nulled)
    if step.doubt is not None:
        return Status(*step.doubt, nulled)
    if step.coming:
        return Status(State.APPROACH, step.coming, nulled)
    if step.at_rest:
        return Status(State.RESTING, "nulled, no displacement seen", nulled)
    return Status(State.LOCKED, "nulled", nulled)


def _passive(previous: Status, step: StepOutcome) -> Status:
    """Status of a measured step whose pattern is never warped."""
    nulled = previous.nulled_frames + 1 if step.residual_rms_px < LOCK_RESIDUAL_PX else 0
    if step.doubt is not None:
        return Status(*step.doubt, nulled)
    if step.coming and nulled >= LOCK_FRAMES:
        return Status(State.APPROACH, step.coming, nulled)
    if nulled >= LOCK_FRAMES and step.at_rest:
        return Status(State.RESTING, "no displacement seen", nulled)
    return Status(State.PASSIVE, "an open loop: the pattern is not warped", nulled)
