"""What the loop is doing, in an operator's words.

    STARTING --usable frame--> NULLING --residual small 3 frames running--> LOCKED <--at rest?--> RESTING
                                  ^                                           |                     |
                                  +---------------- residual large -----------+---------------------+

    any of these five --no usable new information--> HOLDING (STARTING keeps its name; the warp is held)
    any of these six  --few nodes still seen--> LOST
    any of these seven  --asked to pause--> PAUSED (frames are measured, the warp is held) until resumed
    any              --device lost, wrong frame, stalled--> FAULT
    HOLDING, LOST, FAULT --usable frame--> NULLING, LOCKED, RESTING or LOST by its figures
    any              --asked to stop--> STOPPED, which is final

A frame that is held neither counts as small nor breaks the row of small ones. FAULT and LOST are not
left by holding. LOST, as a state, is the whole loop's; a single lost node is a flag of its warp.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

LOCK_RESIDUAL_PX = 0.05
"""Residual rms over valid nodes, camera px, under which a frame counts as nulled."""

LOCK_FRAMES = 3
"""Nulled frames running that make a lock."""

LOST_BELOW = 0.5
"""Share of the nodes usable at rest that must be valid, or the loop is lost."""


class State(enum.StrEnum):
    """The loop's state."""

    STARTING = "starting"
    RESTING = "resting"
    NULLING = "nulling"
    LOCKED = "locked"
    LOST = "lost"
    HOLDING = "holding"
    PAUSED = "paused"
    FAULT = "fault"
    STOPPED = "stopped"


NULLED = frozenset({State.LOCKED, State.RESTING})
"""States in which the camera sees the target: a reading of a held press counts."""


class Outcome(enum.Enum):
    """What one turn of the loop came to."""

    MEASURED = enum.auto()  # a frame was measured; the turn's figures say how well
    HELD = enum.auto()  # nothing new that may be used
    PAUSED = enum.auto()  # a frame was measured, and corrections are to wait
    FAILED = enum.auto()  # a device is lost or gives what it must not
    STOP = enum.auto()  # the run ends


@dataclass(frozen=True, slots=True)
class Turn:
    """One turn's outcome. The figures count only when it was measured; `reason` explains the others."""

    outcome: Outcome
    reason: str = ""
    residual_rms_px: float = float("nan")
    valid_share: float = 0.0
    at_rest: bool = False


@dataclass(frozen=True, slots=True)
class Status:
    """State, why, and how many measured frames running were nulled."""

    state: State = State.STARTING
    reason: str = "waiting for the first frame"
    nulled_frames: int = 0


def next_status(previous: Status, turn: Turn) -> Status:
    """Status after a turn; see the module's diagram."""
    state = previous.state
    if state is State.STOPPED:
        return previous
    match turn.outcome:
        case Outcome.STOP:
            return Status(State.STOPPED, turn.reason)
        case Outcome.FAILED:
            return Status(State.FAULT, turn.reason)
        case Outcome.HELD:
            kept = state in {State.STARTING, State.LOST, State.FAULT}
            return Status(state if kept else State.HOLDING, turn.reason, previous.nulled_frames)
        case Outcome.PAUSED:
            return Status(State.PAUSED, turn.reason, previous.nulled_frames)
        case Outcome.MEASURED:
            return _measured(previous, turn)


def _measured(previous: Status, turn: Turn) -> Status:
    if turn.valid_share < LOST_BELOW:
        return Status(State.LOST, turn.reason or f"{100 * turn.valid_share:.0f} % of the nodes are seen")
    if not turn.residual_rms_px < LOCK_RESIDUAL_PX:
        return Status(State.NULLING, f"residual {turn.residual_rms_px:.3g} px")
    nulled = previous.nulled_frames + 1
    if nulled < LOCK_FRAMES:
        return Status(State.NULLING, f"nulled for {nulled} of {LOCK_FRAMES} frames", nulled)
    if turn.at_rest:
        return Status(State.RESTING, "nulled, no displacement seen", nulled)
    return Status(State.LOCKED, "nulled", nulled)
