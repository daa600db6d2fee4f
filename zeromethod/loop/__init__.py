"""The null loop: one frame round the circle, the loop's states, and what it does when a device fails."""

from zeromethod.loop.circle import Circle
from zeromethod.loop.events import Event
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import LOCK_FRAMES, LOCK_RESIDUAL_PX, NULLED, State, Status, next_status
from zeromethod.loop.step import Step

__all__ = [
    "LOCK_FRAMES",
    "LOCK_RESIDUAL_PX",
    "NULLED",
    "Circle",
    "Event",
    "Loop",
    "State",
    "Status",
    "Step",
    "next_status",
]
