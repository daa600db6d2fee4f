"""What a person should do in each state of the loop, and why depth may not count, in one line each."""

from __future__ import annotations

from zeromethod.loop.state import State

ADVICE = {
    State.STARTING: "",
    State.RESTING: "",
    State.NULLING: "",
    State.LOCKED: "",
    State.APPROACH: "",
    State.PASSIVE: "",
    State.UNCALIBRATED: "Depth is relative. Run zeromethod calibrate to have millimetres.",
    State.MOVED: "Fasten what moved, clear the mirror, then take a zero (z), or calibrate again.",
    State.COVERED: "Take away what covers the mirror.",
    State.LOST: "Check light, LCD and camera; take away what hides the mirror.",
    State.HOLDING: "Wait; if it lasts, check camera and LCD.",
    State.PAUSED: "Corrections wait. Press p to go on.",
    State.FAULT: "Check the cables and the power of the device that is named.",
    State.STOPPED: "The run has ended.",
}
"""By state; empty where there is nothing to do."""

FRESH = frozenset(State) - {State.STARTING, State.LOST, State.HOLDING, State.FAULT, State.STOPPED}
"""States in which every new frame is measured: readings are of now, unless they come late."""

LATE_S = 0.5
"""Age from which a reading counts as held, of the run's clock."""

_DOUBTS = {
    State.MOVED: "the bench moved: depth does not count",
    State.COVERED: "the mirror is covered: depth does not count",
    State.LOST: "lost: depth does not count",
    State.HOLDING: "held: no frame that may be used",
    State.PAUSED: "paused: motion of the bench is not checked",
    State.FAULT: "held: a device failed",
    State.STOPPED: "held: the run has ended",
}


def doubt_of(state: State, late_s: float | None) -> str:
    """Why the newest depth is not to be relied on; "" where it is, as far as its sigma and calibration say.

    late_s: how much older the reading is than the newest frame, s; None: nothing was read.
    """
    late = late_s is not None and late_s > LATE_S
    return _DOUBTS.get(state, "") or (f"held: read {late_s:.1f} s ago" if late else "")
