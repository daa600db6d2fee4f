"""The simulated watch camera: two lenses that look from below through the rubber at what comes.

Every pixel's ray goes through the camera face and the mirror as it is pressed at that moment, is refracted at
both, and ends at an object of the scenario or in the room behind, which is so far away that only the ray's
direction counts. Objects are where their path has them; a depth below 0 is a height above the mirror.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Image, Mask
from zeromethod.clock import Clock, HostClock
from zeromethod.devices.protocols import CameraLost, CameraTimeout, Frame, gives_buffers
from zeromethod.errors import InputError
from zeromethod.optics.camera import CameraModel
from zeromethod.optics.layers import through_slabs
from zeromethod.optics.mirror import Dented, Flat, height_field, normal_of
from zeromethod.optics.prism import PrismGeometry
from zeromethod.optics.vectors import dot, unit
from zeromethod.rig.model import Prism, Rig, WatchSpec
from zeromethod.simulation.contact.objects import Form, Solid
from zeromethod.simulation.path import place_at
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.room import Room
from zeromethod.simulation.scenario import Scenario, scenario_of
from zeromethod.simulation.sensor import Sensor

UNDERSIDE = 0.5
"""Light on the underside of an object over that of the room behind it, which lights it from beside."""
VEIL = 0.02
"""Share of full scale that the LCD adds: what the mirror reflects of it below total reflection, even here."""
_LENS_MM = 150.0
"""Roughly how far the lenses are from the mirror, for the size of a pixel on an object."""
_STREAM = 7


class SimulatedWatchCamera:
    """A `Camera` of the rig's table `[watch]`: both views side by side, newest frame only.

    shape, bits: (rows, cols) of every frame, and significant bits per pixel.

    It lives on the run's clock, which it never moves in simulated time: a frame that is not there yet is a
    time-out at once.
    """

    def __init__(self, rig: Rig, clock: Clock) -> None:
        """Open; raises InputError for a rig without a watch camera, CameraLost while it is gone."""
        if rig.watch is None:
            raise InputError("watch: missing; the simulated watch camera needs it")
        self._rig, self._clock, self._spec = rig, clock, rig.watch
        self.shape, self.bits = (rig.watch.rows, rig.watch.columns), rig.watch.bits
        self.scenario: Scenario = scenario_of(rig)
        self._room = Room(rig)
        self._sensor = Sensor(rig.model_copy(update={"camera": rig.watch}), _STREAM)
        self._entry, self._inside = _inside_rays(rig, rig.watch)
        self._rest = _out(self._entry, self._inside, Mirror(), rig.prism)
        self._last = -1
        self._check(clock.now_ns())

    @gives_buffers
    def read(self, timeout_s: float) -> Frame:
        """Newest frame not yet returned; raises CameraTimeout or CameraLost."""
        number = self._newest()
        if number <= self._last and isinstance(self._clock, HostClock):
            self._clock.sleep_until_ns(self._clock.now_ns() + round(1e9 * timeout_s))
            number = self._newest()
        if number <= self._last:
            raise CameraTimeout(f"no frame within {timeout_s:g} s")
        dropped, self._last = number - self._last - 1, number
        time_ns = round(1e9 * number / self._spec.rate_hz)
        if self._faulty("repeat", time_ns):
            number = round(self._rig.simulation.faults.watch_s[0] * self._spec.rate_hz)
        seen_ns = round(1e9 * number / self._spec.rate_hz)
        return Frame(
            self.image(seen_ns, number), time_ns, round(1e9 * self._spec.exposure_s), self._last, dropped
        )

    def close(self) -> None:
        """Nothing to release."""

    def image(self, time_ns: int, number: int) -> Image:
        """(rows, cols) grey levels: what is seen at a time, with the noise of frame `number`."""
        light = self.light(1e-9 * time_ns)
        if self._faulty("dark", time_ns):
            light = np.zeros_like(light)
        return self._sensor.image(light.astype(np.float32), number)

    def light(self, time_s: float) -> Float:
        """(rows, cols) light without noise, 1 for full scale."""
        time_ns = round(1e9 * time_s)
        mirror = self.scenario.mirror_at(time_ns)
        still = not (mirror.dents or mirror.touches)
        point, direction = self._rest if still else _out(self._entry, self._inside, mirror, self._rig.prism)
        seen = np.isfinite(direction[..., 2])
        light = np.where(seen, self._room.light(direction, time_s), 0.0).astype(np.float64)
        for each in self.scenario.objects:
            x_mm, y_mm, depth_mm = place_at(each.points, time_ns)
            foot = np.array([x_mm, y_mm, -depth_mm])
            near = seen & _near(each.solid, foot, point, direction)
            if near.any():
                shade, cover = _seen(each.solid, foot, point[near], direction[near], self._spec)
                level = UNDERSIDE * each.solid.albedo * self._room.level(time_s)
                light[near] += cover * (level * shade - light[near])
        return VEIL + (1 - VEIL) * light

    def _newest(self) -> int:
        """Number of the newest frame that is in hand."""
        now_ns = self._clock.now_ns()
        self._check(now_ns)
        if self._faulty("stall", now_ns):
            now_ns = round(1e9 * self._rig.simulation.faults.watch_s[0])
        latency_s = 0.5 * self._spec.exposure_s + self._rig.simulation.camera_latency_s
        return int(np.floor((1e-9 * now_ns - latency_s) * self._spec.rate_hz))

    def _faulty(self, kind: str, now_ns: int) -> bool:
        faults = self._rig.simulation.faults
        return faults.watch == kind and faults.watch_s[0] <= 1e-9 * now_ns < faults.watch_s[1]

    def _check(self, now_ns: int) -> None:
        if self._faulty("lost", now_ns):
            raise CameraLost("the simulated watch camera is gone")


def _inside_rays(rig: Rig, spec: WatchSpec) -> tuple[Float, Float]:
    """Points on the camera face and directions in the rubber, each (rows, cols, 3); NaN beside the face."""
    half, pose = spec.columns // 2, CameraModel.place(spec)
    assert spec.focal_px is not None
    matrix = np.array([[spec.focal_px[0], 0, 0], [0, spec.focal_px[1], 0], [0, 0, 1.0]])
    face = PrismGeometry(rig.prism).camera_face
    views = []
    for right in (False, True):
        cx = half - 1 - spec.centre_px[0] if right else spec.centre_px[0]
        v, u = np.mgrid[: spec.rows, :half].astype(np.float64)
        pixels = np.stack([u - cx, v - spec.centre_px[1]], axis=-1).reshape(-1, 1, 2)
        x, y = cv2.undistortPoints(pixels, matrix, np.array(spec.distortion)).reshape(spec.rows, half, 2).T
        ray = unit(pose.axis + x.T[..., None] * pose.u_axis + y.T[..., None] * pose.v_axis)
        lens = pose.position + (0.5 if right else -0.5) * spec.baseline_mm * pose.u_axis
        entry = lens + (face.depth_below(lens) / dot(ray, face.normal))[..., None] * ray
        entry[~face.contains(entry)] = np.nan
        views.append((entry, through_slabs(ray, -face.normal, 1.0, (), rig.prism.index)[1]))
    entries, inside = (np.concatenate(both, axis=1) for both in zip(*views, strict=True))
    return entries, inside


def _out(entry: Float, inside: Float, mirror: Mirror, prism: Prism) -> tuple[Float, Float]:
    """Where rays leave the rubber by the pressed mirror, and their directions in the air, (rows, cols, 3)."""
    height, surface = np.zeros(entry.shape[:2]), Dented(height_field(prism.rest), mirror)
    for _ in range(1 if isinstance(surface.rest, Flat) and not mirror.dents else 3):
        way = (height - entry[..., 2]) / inside[..., 2]
        point = entry + way[..., None] * inside
        x, y = point[..., 0], point[..., 1]
        height = surface.height(x, y)
    normal = normal_of(surface.gradient(x, y))
    direction = through_slabs(inside, normal, prism.index, (), 1.0)[1]
    direction[~PrismGeometry(prism).on_mirror(x, y)] = np.nan
    return point, direction


def _near(solid: Solid, foot: Float, point: Float, ray: Float) -> Mask:
    """(rows, cols) rays that may meet an object: those that come near it at the height of its middle."""
    middle = foot[2] + (0.0 if solid.flat else solid.radius_mm)
    with np.errstate(invalid="ignore"):
        reach = (middle - point[..., 2]) / ray[..., 2]
        off = [point[..., k] + reach * ray[..., k] - foot[k] for k in (0, 1)]
        return np.asarray(np.hypot(*off) < 1.5 * solid.radius_mm + solid.length_mm / 2 + 3.0)


def _seen(solid: Solid, foot: Float, point: Float, ray: Float, spec: WatchSpec) -> tuple[Float, Float]:
    """(shade, cover), each (n,), of n rays: an object's underside's light, its share of a ray's pixel.

    foot: (3,) mm, its lowest place. A ball is a sphere, a punch a thin round plate, an edge a round rod.
    """
    radius = solid.radius_mm
    if solid.flat:
        reach = (foot[2] - point[..., 2]) / ray[..., 2]
        met = point + reach[..., None] * ray - foot
        off = np.hypot(met[..., 0], met[..., 1])
        slant = ray[..., 2]
    else:
        off = _beside(solid, foot + np.array([0.0, 0.0, radius]), point, ray)
        reach, slant = foot[2] + radius - point[..., 2], np.ones_like(off)
    assert spec.focal_px is not None
    footprint = (_LENS_MM + np.abs(reach)) / float(np.mean(spec.focal_px))
    cover = np.clip(0.5 + (radius - off) * slant / footprint, 0.0, 1.0)
    facing = np.sqrt(np.clip(1.0 - (off / radius) ** 2, 0.0, 1.0))
    return (np.ones_like(off) if solid.flat else 0.6 + 0.4 * facing), np.asarray(cover)


def _beside(solid: Solid, middle: Float, point: Float, ray: Float) -> Float:
    """Distance (n,), mm, of rays from a sphere's middle or a rod's axis."""
    to = middle - point
    along = np.sum(to * ray, axis=-1)
    if solid.form is not Form.EDGE:
        return np.asarray(np.linalg.norm(to - along[..., None] * ray, axis=-1))
    angle = np.radians(solid.angle_deg)
    axis = np.array([np.cos(angle), np.sin(angle), 0.0])
    mixed, ends = ray @ axis, to @ axis
    # the place on the axis nearest to the ray, kept on the rod
    at = (mixed * along - ends) / (1.0 - mixed**2)
    half = solid.length_mm / 2
    nearest = to + np.clip(at, -half, half)[..., None] * axis
    along = np.sum(nearest * ray, axis=-1)
    return np.asarray(np.linalg.norm(nearest - along[..., None] * ray, axis=-1))
