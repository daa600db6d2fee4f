"""A rig's circle, put together once and tried with made-up frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.control.controller import controller_of
from zeromethod.devices.protocols import Frame
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
from zeromethod.pattern.stepping import shift_of
from zeromethod.pattern.strips import Strips
from zeromethod.rig.model import Rig
from zeromethod.sensing.sensor import ResidualSensor, Sensor
from zeromethod.surface.expected_light import ExpectedLight
from zeromethod.surface.lamp_light import LampLight
from zeromethod.warp.rest import Rest

_FRAMES = 8
"""Enough for a motion to be accepted and predicted."""

_STEP_PX = 2
"""Camera px per frame that the made-up picture moves by: pictures mix, nodes move, nothing saturates."""


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

    def circle() -> Circle:
        watch = None
        if strips is not None:
            reader = StripReader(strips, rest.grid.image_shape, rig.camera.noise, rig.camera.bits)
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
        return Circle(rest, exposures, sensor, controller, black_grey, expected, blur, order, coded, unsteady)

    warm_up(circle(), target, rig)
    return CircleParts(rest, strips, circle())


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


def warm_up(circle: Circle, target: Target, rig: Rig) -> None:
    """Send made-up frames round a circle of its own, which is of no use afterwards.

    They show the target drifting along u while every exposure spans two presentations, so that all steps of
    the circle run, those of a moving mirror too.
    """
    camera = rig.camera
    u, v = np.meshgrid(np.arange(camera.columns), np.arange(camera.rows))
    grey = np.rint(0.8 * (2**camera.bits - 1) * target.light(u, v))
    image = grey.astype(np.uint8 if camera.bits == 8 else np.uint16)
    frame_ns, exposure_ns = round(1e9 / camera.rate_hz), round(1e9 * camera.exposure_s)
    for number in range(_FRAMES):
        time_ns = number * frame_ns
        shown_ns, q = time_ns - exposure_ns // 4, circle.controller.commanded
        shift = shift_of(rig.target.step, number)
        circle.presented(shown_ns, q, source_ns=circle.source_ns, shift=shift)
        drifting = np.ascontiguousarray(np.roll(image, _STEP_PX * number, axis=1))
        circle.take(Frame(drifting, time_ns, exposure_ns, number))
