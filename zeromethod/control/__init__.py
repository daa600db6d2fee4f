"""The circle: what was shown, what was measured in it, what to show next, and the loop's states."""

from zeromethod.control.circle import Circle
from zeromethod.control.composition import Composition, Controller
from zeromethod.control.events import Event
from zeromethod.control.integrator import Integrator
from zeromethod.control.loop import Loop
from zeromethod.control.observation import Observation, measure
from zeromethod.control.pairing import PanelTiming, Shown, pair
from zeromethod.control.presentation import PresentationLog
from zeromethod.control.rest import Rest
from zeromethod.control.state import LOCK_FRAMES, LOCK_RESIDUAL_PX, NULLED, State, Status, next_status
from zeromethod.control.step import Step

__all__ = [
    "LOCK_FRAMES",
    "LOCK_RESIDUAL_PX",
    "NULLED",
    "Circle",
    "Composition",
    "Controller",
    "Event",
    "Integrator",
    "Loop",
    "Observation",
    "PanelTiming",
    "PresentationLog",
    "Rest",
    "Shown",
    "State",
    "Status",
    "Step",
    "measure",
    "next_status",
    "pair",
]
