"""Whether a bench's geometry is known, and what its readings are to state of it."""

from __future__ import annotations

from zeromethod.loop.state import READ, Doubt, State
from zeromethod.loop.step import Step
from zeromethod.rig.model import Rig
from zeromethod.simulation.camera import SimulatedCamera

DOUBT = Doubt(State.UNCALIBRATED, "depth is relative; zeromethod calibrate makes it millimetres")


def is_known(rig: Rig, camera: object) -> bool:
    """Whether the rig's geometry is that of the bench.

    It was calibrated, is declared exact, or the camera simulates this very rig.
    """
    if rig.geometry.known != "nominal":
        return True
    return isinstance(camera, SimulatedCamera) and camera.simulates(rig)


def is_readable(step: Step) -> bool:
    """Whether a step's surface is to be read: it was measured, and an uncalibrated bench is nulled.

    There the delay is not known either, and a picture that came late may read as millimetres.
    """
    return step.measured is not None and (step.calibrated or step.state in READ)


def with_stated_geometry(rig: Rig, camera: object) -> tuple[Rig, Doubt | None]:
    """Rig whose readings state what is not known of its geometry, and why they must not be trusted, if so.

    Raises MeasurementError where too little of the mirror is seen.
    """
    if is_known(rig, camera):
        return rig, None
    from zeromethod.calibration.nominal import stated  # noqa: PLC0415 - loads slowly

    return stated(rig), DOUBT
