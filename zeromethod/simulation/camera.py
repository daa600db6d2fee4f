"""The simulated camera: frames on its own clock, of the simulated display by way of the mirror."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from zeromethod.arrays import Image, Single
from zeromethod.clock import Clock
from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame, gives_buffers
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig
from zeromethod.simulation.bump import moved_rig, moved_share
from zeromethod.simulation.display import SimulatedDisplay
from zeromethod.simulation.faults import Delivery
from zeromethod.simulation.nuisances import Nuisances, warmed_rig
from zeromethod.simulation.panel import Presentation, SimulatedPanel
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.scenario import Scenario, scenario_of
from zeromethod.simulation.sensor import Sensor
from zeromethod.simulation.surroundings import Surroundings

LEAST_EXPOSURE_S = 1e-5


class SimulatedCamera:
    """A `Camera` that looks at a `SimulatedDisplay`.

    Frame n starts at (phase + n) / rate plus jitter, whoever reads or not; numbers count from time 0 of the
    clock. Only frames that `read` returns are drawn, and a frame depends on its number and on what was
    shown, not on which frames were read before. After a loss and reopening the count goes on.
    """

    def __init__(self, rig: Rig, clock: Clock, display: object) -> None:
        """Open; raises InputError for a foreign display or a bad press file, CameraLost while it is gone."""
        if not isinstance(display, SimulatedDisplay):
            kind = type(display).__name__
            raise InputError(f"camera.driver: simulated: sees only display.driver 'simulated', not {kind}")
        self._rig = rig
        self._clock = clock
        self._display = display
        self.scenario: Scenario = scenario_of(rig)
        self._delivery = Delivery(rig)
        self._sensor = Sensor(rig)
        self._nuisances = Nuisances(rig)
        self._surroundings = Surroundings(rig)
        self._moved = 0.0, 0.0
        self._closed = False
        opened_ns = clock.now_ns()
        if self._delivery.gone(opened_ns):
            raise CameraLost("the simulated camera is gone")
        lost_ns = self._delivery.lost_at()
        self._lost_ns = lost_ns if lost_ns is not None and opened_ns < lost_ns else None
        self._last = self._delivery.first_from(opened_ns) - 1
        self._keep_pictures()

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, cols) of every frame."""
        return self._rig.camera.rows, self._rig.camera.columns

    @property
    def bits(self) -> int:
        """Significant bits per pixel."""
        return self._rig.camera.bits

    def simulates(self, rig: Rig) -> bool:
        """Whether the light follows the geometry of `rig`."""
        return _geometry(self._rig) == _geometry(rig)

    def truth(self, time_ns: int) -> Mirror:
        """Return the mirror as it truly is at `time_ns`."""
        return self.scenario.mirror_at(time_ns)

    @gives_buffers
    def read(self, timeout_s: float) -> Frame:
        """Newest frame not yet returned, moving the clock up to `timeout_s` when there is none yet.

        Raises CameraTimeout (the clock stands `timeout_s` later) or CameraLost.
        """
        now_ns = self._clock.now_ns()
        self._check(now_ns)
        number = self._delivery.newest_until(now_ns, after=self._last)
        if number is None:
            number = self._wait(now_ns + max(0, round(timeout_s * 1e9)), timeout_s)
        dropped = number - self._last - 1
        self._last = number
        image = self._image(number)
        self._keep_pictures()
        exposure_ns = self._delivery.exposure_ns(number)
        middle_ns = self._delivery.start_ns(number) + exposure_ns // 2
        return Frame(image, middle_ns, exposure_ns, number, dropped)

    def set_exposure(self, exposure_s: float) -> float:
        """Expose frames that start from now on for so long; light that is gathered grows with it."""
        longest_s = 1 / self._rig.camera.rate_hz
        if not LEAST_EXPOSURE_S <= exposure_s <= longest_s * (1 + 1e-6):
            allowed = f"at least {LEAST_EXPOSURE_S:g} and at most {longest_s:.6g}"
            raise InputError(f"camera.exposure_s: {exposure_s:g}: the simulated camera takes {allowed}")
        exposure_ns = round(1e9 * exposure_s)
        self._delivery.expose(self._clock.now_ns(), exposure_ns)
        return 1e-9 * exposure_ns

    def close(self) -> None:
        """Stop looking; safe to call twice. The display stays open."""
        if not self._closed:
            self._closed = True
            self._display.keep_from(None)

    def _check(self, now_ns: int) -> None:
        if self._closed:
            raise CameraLost("the simulated camera is closed")
        if self._lost_ns is not None and now_ns >= self._lost_ns:
            raise CameraLost(f"the simulated camera was lost at {self._lost_ns * 1e-9:.3f} s")

    def _wait(self, until_ns: int, timeout_s: float) -> int:
        """Move the clock to the next frame's arrival and return its number."""
        number = self._delivery.next_until(until_ns, after=self._last)
        arrival_ns = until_ns if number is None else self._delivery.arrival_ns(number)
        if self._lost_ns is not None and self._lost_ns <= arrival_ns:
            self._clock.sleep_until_ns(self._lost_ns)
            self._check(self._lost_ns)
        self._clock.sleep_until_ns(arrival_ns)
        if number is None:
            raise CameraTimeout(f"no frame within {timeout_s:g} s")
        return number

    def _keep_pictures(self) -> None:
        self._display.keep_from(self._delivery.start_ns(self._delivery.oldest_used(self._last + 1)))

    def _image(self, number: int) -> Image:
        """Image of a frame with its planted faults."""
        if self._delivery.repeated(number):
            return self._image(number - 1)
        image = self._exposed(number)
        if self._delivery.torn(number):
            half = image.shape[0] // 2
            image[half:] = self._exposed(number - 1)[half:]
        return image

    def _exposed(self, number: int) -> Image:
        """Image of what frame `number` was truly exposed to."""
        start_ns = self._delivery.start_ns(number)
        exposure_ns = self._delivery.exposure_ns(number)
        end_ns = start_ns + exposure_ns
        moved = moved_share(self._rig, number), self._nuisances.kelvin(start_ns)
        if moved != self._moved:
            rig = warmed_rig(moved_rig(self._rig, moved[0]), moved[1])
            self._display.renderer.move(rig)
            self._surroundings.move(rig)
            self._moved = moved
        backlight = self._rig.light.brightness * self._nuisances.backlight(start_ns, end_ns)
        pieces = exposure_pieces(
            self.scenario,
            self._display.panel,
            self._display.presentations,
            start_ns,
            end_ns,
            backlight=backlight if self._delivery.lit(number) else 0.0,
        )
        projector = self._display.projector
        projected = None if projector is None else projector.luminance(start_ns, end_ns)
        light: Single = self._display.renderer.expose(pieces, projected)
        mirror = self.scenario.mirror_at((start_ns + end_ns) // 2)
        light = self._surroundings.on(light, mirror, start_ns, end_ns)
        light = self._nuisances.on(light, start_ns, end_ns)
        gathered = np.float32(1e-9 * exposure_ns / self._rig.camera.exposure_s)
        return self._sensor.image(light if gathered == 1 else gathered * light, number)


_GAUSS_LEGENDRE = 1 / np.sqrt(3.0)


def exposure_pieces(
    scenario: Scenario,
    panel: SimulatedPanel,
    presentations: Sequence[Presentation],
    from_ns: int,
    to_ns: int,
    backlight: float = 1.0,
) -> list[Piece]:
    """Pieces of the exposure [from_ns, to_ns]; their weights add up to 1.

    It is cut where the scenario jumps or bends. A part in which the mirror stands still is one piece; one in
    which it moves is two, with the mirror at the two Gauss-Legendre instants (exact for motion whose effect
    is cubic in time) and the panel's light of each half. backlight: the panel's light over the usual.
    """
    cuts = [from_ns, *scenario.bends_ns(from_ns, to_ns), to_ns]
    pieces = []
    for start, end in pairwise(cuts):
        middle, half = (start + end) // 2, (end - start) / 2
        if scenario.moving(start, end):
            shift = round(half * _GAUSS_LEGENDRE)
            parts = [(start, middle, middle - shift), (middle, end, middle + shift)]
        else:
            parts = [(start, end, middle)]
        for part_from, part_to, at in parts:
            pictures = panel.weights(presentations, part_from, part_to)
            if backlight != 1:
                pictures = [(handle, np.float32(backlight) * share) for handle, share in pictures]
            weight = (part_to - part_from) / (to_ns - from_ns)
            pieces.append(Piece(weight, scenario.mirror_at(at), pictures))
    return pieces


def _geometry(rig: Rig) -> tuple[object, ...]:
    """What decides where the rays go."""
    display, camera = rig.display, rig.camera
    panel = display.columns, display.rows, display.pitch_mm, display.centre_mm
    pose = camera.position_mm, camera.look_at_mm, camera.roll_deg
    lens = camera.projection, camera.focal_px, camera.pixel_mm, camera.centre_px, camera.distortion
    laid = display.turn_deg, display.mirrored, display.tilt_deg
    return (rig.prism, rig.pattern_layers, rig.camera_layers, *panel, *laid, *pose, *lens)
