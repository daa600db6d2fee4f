"""What a person should do in each state of the loop, in one line."""

from __future__ import annotations

from zeromethod.loop.state import State

ADVICE = {
    State.STARTING: "",
    State.RESTING: "",
    State.NULLING: "",
    State.LOCKED: "",
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

FRESH = frozenset(
    {State.RESTING, State.NULLING, State.LOCKED, State.UNCALIBRATED, State.MOVED, State.PAUSED, State.COVERED}
)
"""States in which every new frame is measured: readings are of now."""
