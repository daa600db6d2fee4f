"""Whether a bench's geometry is known, and what its readings are to state of it."""

from __future__ import annotations

from dataclasses import replace

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


def to_read(step: Step) -> Step:
    """The step as it is to be read: not at all where an uncalibrated bench is on its way to the null.

    There its delay is not known either, and a picture that came late may read as millimetres.
    """
    return step if step.calibrated or step.state in READ else replace(step, measured=None)


def with_stated_geometry(rig: Rig, camera: object) -> tuple[Rig, Doubt | None]:
    """Rig whose readings state what is not known of its geometry, and why they must not be trusted, if so.

    Raises MeasurementError where too little of the mirror is seen.
    """
    if is_known(rig, camera):
        return rig, None
    from zeromethod.calibration.nominal import stated  # noqa: PLC0415 - loads slowly

    return stated(rig), DOUBT
