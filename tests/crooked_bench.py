"""A bench that stands otherwise than its rig file says, by about a caliper's sigma in everything."""

from small_rigs import with_tables

from zeromethod.calibration import build, describe
from zeromethod.rig.model import Rig

OFF = {
    "display.along_mm": 1.1,
    "display.across_mm": -0.8,
    "display.turn_deg": 0.5,
    "gap_mm": 0.12,
    "camera.x_mm": 2.0,
    "camera.z_mm": -1.5,
    "camera.heading_deg": 0.2,
    "camera.roll_deg": -0.4,
    "camera.scale": 0.01,
    "prism.index": 0.004,
    "prism.pattern_angle_deg": 0.2,
}
"""Truth less the rig file, by parameter."""

GAMMA = 2.0


def crooked(given: Rig) -> Rig:
    """The bench as it is, whose rig file says `given`."""
    middle = describe(given)
    rig = build(given, {name: middle[name] + off for name, off in OFF.items()})
    return with_tables(rig, display={"gamma": GAMMA})
