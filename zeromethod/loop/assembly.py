"""A rig's circle, put together."""

from __future__ import annotations

from dataclasses import dataclass

from zeromethod.control.controller import controller_of
from zeromethod.exposure.delay import DelayWatch
from zeromethod.exposure.exposures import Exposures
from zeromethod.exposure.pairing import PanelTiming
from zeromethod.exposure.strip_reading import StripReader, find_strips
from zeromethod.exposure.target_phase import Sight
from zeromethod.loop.burst import Burst
from zeromethod.loop.circle import Circle
from zeromethod.loop.order_check import OrderCheck
from zeromethod.loop.panel_blur import PanelBlur
from zeromethod.loop.unsteady_nodes import UnsteadyNodes
from zeromethod.optics import Optics
from zeromethod.pattern import Target
from zeromethod.pattern.strips import Strips
from zeromethod.rig.model import Rig
from zeromethod.sensing.sensor import ResidualSensor, Sensor
from zeromethod.surface.expected_light import ExpectedLight
from zeromethod.surface.lamp_light import LampLight
from zeromethod.warp.rest import Rest


@dataclass(frozen=True)
class CircleParts:
    """The circle without what shows its pictures.

    rest: without the nodes that coded strips cover. strips: None without.
    """

    rest: Rest
    strips: Strips | None
    circle: Circle


def make_circle(
    rig: Rig, optics: Optics, sensor: Sensor | None = None, rest: Rest | None = None
) -> CircleParts:
    """Make the circle of a rig, rehearsed. sensor, rest: in place of the rig's.

    What it makes of the same frames and presentations is the same in every process, bit for bit. Raises
    InputError for a rig that sees no display.
    """
    rest = rest or Rest.of(rig, optics)
    strips = find_strips(rig, rest)
    covered = strips.covered(rest.grid) if strips else None
    if covered is not None:
        rest = rest.without(covered)
    target = Target.from_spec(rig.target)
    sensor = sensor or ResidualSensor.from_rig(rig, rest.grid, target.light, covered)
    light = (LampLight if rig.light.by_mirror else ExpectedLight)(optics, rest)
    timing = PanelTiming.of(rig.display)
    panel, diagonal = (timing.rows, timing.upwards), rig.target.kind == "checker"
    spread = rig.camera.psf_px**2 + 1 / 12, rig.display.fill_factor[1] ** 2 / 12
    sight = Sight.of(rest.q, rest.grid.period_px, diagonal, panel, spread)

    watch = None
    if strips is not None:
        reader = StripReader(strips, rig.camera.noise, rig.camera.bits)
        watch = DelayWatch(reader, timing, rig.display.refresh_hz)
    exposures = Exposures(rest.grid, timing, rig.target.kind, watch, sight)
    controller = controller_of(rig.control, rest)
    black_grey = rig.camera.noise.black_grey
    blur = PanelBlur(rig, rest.grid)
    expected = light if light.needed else None
    keeps = controller.keeps_pictures
    order, coded = (order_check(rig, rest), burst(rig, rest)) if keeps else (None, None)
    saw = rest.seams is not None
    unsteady = UnsteadyNodes(rest.grid.shape, at_rest=saw) if rig.target.step or saw else None
    circle = Circle(rest, exposures, sensor, controller, black_grey, expected, blur, order, coded, unsteady)
    return CircleParts(rest, strips, circle)


def order_check(rig: Rig, rest: Rest) -> OrderCheck | None:
    """Make what finds the carrier's order; None where none is looked for.

    Noise has none, and a bench that was not calibrated has no rest that orders count from.
    """
    kind = rig.target.kind
    if kind == "noise" or rig.geometry.relative:
        return None
    return OrderCheck(rest, diagonal=kind == "checker")


def burst(rig: Rig, rest: Rest) -> Burst | None:
    """Make what reads the warp where no picture can null; None where the rig wants none."""
    # what rubs moves on before the coded pictures have been shown
    rubs = rig.control.rubbing and rig.control.burst == "when-needed"
    if rubs or rig.control.burst == "never":
        return None
    return Burst(rest, rig.camera.noise.black_grey, always=rig.control.burst == "always")
