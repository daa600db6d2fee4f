"""What a rig's loop is made of, put together once and tried."""

from __future__ import annotations

from dataclasses import dataclass

from zeromethod.devices.protocols import Display
from zeromethod.exposure.delay import DelayWatch
from zeromethod.exposure.exposures import Exposures
from zeromethod.exposure.pairing import PanelTiming
from zeromethod.exposure.strip_reading import StripReader, find_strips
from zeromethod.loop.circle import Circle, Sensor, controller_of
from zeromethod.loop.drawing import Drawer, Drawing
from zeromethod.loop.warm_up import warm_up
from zeromethod.optics import Optics
from zeromethod.pattern import Target
from zeromethod.pattern.strips import Strips
from zeromethod.rig.model import Rig
from zeromethod.sensing.sensor import ResidualSensor
from zeromethod.surface.expected_light import ExpectedLight
from zeromethod.warp.rest import Rest


@dataclass(frozen=True)
class Assembly:
    """The parts. rest: without the nodes that coded strips cover."""

    rest: Rest
    circle: Circle
    drawing: Drawing


@dataclass(frozen=True)
class CircleParts:
    """The circle without what shows its pictures. rest: as in `Assembly`. strips: None without."""

    rest: Rest
    strips: Strips | None
    circle: Circle


def assemble(rig: Rig, display: Display, optics: Optics, sensor: Sensor | None, live: bool) -> Assembly:
    """Make the parts for one run. live: draw in a thread of its own. sensor: in place of the rig's.

    Raises InputError for a rig that sees no display, or where nothing can draw.
    """
    parts = make_circle(rig, optics, sensor)

    def drawer() -> Drawer:
        return Drawer(rig, display, parts.rest, parts.strips)

    coded = parts.strips is not None
    drawing = Drawing(drawer, coded, rig.control.timeout_s, live)
    return Assembly(parts.rest, parts.circle, drawing)


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
    light = ExpectedLight(optics, rest)
    timing = PanelTiming.of(rig.display)

    def circle() -> Circle:
        watch = None
        if strips is not None:
            reader = StripReader(strips, rest.grid.image_shape, rig.camera.noise, rig.camera.bits)
            watch = DelayWatch(reader, timing, rig.display.refresh_hz)
        exposures = Exposures(rest.grid, timing, rig.target.kind, watch)
        controller = controller_of(rig.control, rest)
        black_grey = rig.camera.noise.black_grey
        return Circle(rest, exposures, sensor, controller, black_grey, light if light.needed else None)

    warm_up(circle(), target, rig.camera)
    return CircleParts(rest, strips, circle())
