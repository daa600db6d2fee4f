"""The rest measured at the start of a run, on a bench whose geometry was never calibrated."""

from __future__ import annotations

from zeromethod.commissioning.calibration.plan import Plan
from zeromethod.commissioning.calibration.prompts import Prompts
from zeromethod.commissioning.calibration.rest import capture, decode, sequence_for
from zeromethod.commissioning.calibration.settling import settle
from zeromethod.commissioning.decode import refuse_empty
from zeromethod.commissioning.patterns import TimedPatterns
from zeromethod.devices.opening import Devices
from zeromethod.errors import MeasurementError
from zeromethod.rig.model import Rig
from zeromethod.warp.rest_map import RestMap


def first_rest(rig: Rig, devices: Devices, prompts: Prompts) -> RestMap:
    """LCD position that every pixel sees by the untouched mirror: absolute, whatever the rig file says.

    To be called in the main thread, as windows must be. Raises MeasurementError where it cannot be measured.
    """
    try:
        settling = settle(rig, devices)
        pictures, sequence = TimedPatterns(rig, devices, 0.0), sequence_for(rig)
        pictures.hold_s = settling.hold_s
        with prompts.part("rest", sequence.frames) as advance:
            frames = capture(rig, pictures, sequence, Plan.rest_frames, advance, settling.variance_grey2)
        found = decode(rig, frames)
        refuse_empty(found)
    except MeasurementError as error:
        raise MeasurementError(f"not calibrated, and its rest cannot be measured: {error}") from error
    return found.rest_map
