"""Simulated arrays, with faults: light is followed ray by ray, from detectors by the true mirror to the LEDs.

The estimate shares nothing with it but the rig file and the prism's length. Each detector has sixteen rays,
over its lens and its acceptance; each is reflected by the true dents, which have images in the frame, and
ends in the spots of the LEDs.
"""

from __future__ import annotations

import numpy as np

from zeromethod.arrays import Float
from zeromethod.light_array.devices import FULL_SCALE, Counts, LightArrays, Readings
from zeromethod.light_array.rig import SIDE, LightArrayRig
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.scenario import Scenario, load_scenario

_PAIRS = np.sqrt(2) * np.array([(1, 0), (-1, 0), (0, 1), (0, -1)])
"""Place on the lens and direction, in sigmas, of the four rays along one axis: they have the means and
variances of all light, and so are exact to third order."""

_PASSES = 2
"""Newton steps that find where a ray meets the mirror."""

_RUBBER = Rubber(support="bonded", thickness_mm=20.0)
"""What is pressed: rubber cast onto the LEDs' face, as thick as the prism in the frame's middle, about."""


class FramedMirror:
    """The true mirror in its frame: each dent has images beyond the frame, so that depth along it is 0."""

    def __init__(self, mirror: Mirror, rig: LightArrayRig) -> None:
        self._mirror = mirror
        (self._x0, self._x1), (self._y0, self._y1) = rig.frame.x_mm, rig.frame.y_mm

    def field(self, x: Float, y: Float) -> tuple[Float, Float, Float]:
        """(depth mm, dd/dx, dd/dy) at points."""
        xs = ((x, 1.0), (2 * self._x0 - x, -1.0), (2 * self._x1 - x, -1.0))
        ys = ((y, 1.0), (2 * self._y0 - y, -1.0), (2 * self._y1 - y, -1.0))
        places = np.array([(a, b) for a, _ in xs for b, _ in ys])
        depth = self._mirror.depth(places[:, 0], places[:, 1])
        by_x, by_y = self._mirror.slope(places[:, 0], places[:, 1])
        signs = np.array([(a, b) for _, a in xs for _, b in ys]).reshape(9, 2, *(1,) * x.ndim)
        both = signs[:, 0] * signs[:, 1]
        # an image's own coordinate runs backwards: its slope has the other sign again
        return (both * depth).sum(0), (signs[:, 1] * by_x).sum(0), (signs[:, 0] * by_y).sum(0)

    def peak(self, x: Float, y: Float) -> float:
        """Depth, mm, where |depth| is greatest, found on a grid x (n,), y (m,), then on finer ones around."""
        for _ in range(2):
            across, along = np.meshgrid(x, y)
            depth = self.field(across, along)[0]
            best = int(np.argmax(np.abs(depth)))
            at = across.ravel()[best], along.ravel()[best]
            x, y = (
                np.clip(centre + np.linspace(-1, 1, 21) * (line[1] - line[0]), line[0], line[-1])
                for centre, line in zip(at, (x, y), strict=True)
            )
        return float(depth.ravel()[best])


class SimulatedArrays(LightArrays):
    """Arrays in simulated time, which passes by one reading with each call of `receive`.

    scenario: what presses, from `simulation.begin_s` on.
    """

    def __init__(self, rig: LightArrayRig) -> None:
        self.rig = rig
        self.scenario: Scenario = load_scenario(rig.scenario, _RUBBER)
        spec = rig.simulation
        rng = np.random.default_rng(spec.seed)
        count = SIDE * SIDE
        self._led_gain = 1 + spec.led_spread * rng.standard_normal(count)
        self._detector_gain = 1 + spec.detector_spread * rng.standard_normal(count)
        self._dark = 0.01 + 0.002 * rng.random(count)
        self._noise = np.random.default_rng([spec.seed, 1])
        self._rays = _rays(rig)
        self._waiting: list[tuple[int, Counts]] = []
        self._shown = (0, np.zeros(count, np.uint16))
        self._number = 0
        self._mirror: Mirror | None = None
        self._spots = np.zeros((count, count))
        self._stall_s = spec.stall_s

    def send(self, number: int, levels: Counts) -> None:
        """Have levels lit, `latency_frames` later than the next reading."""
        self._waiting.append((number, levels.copy()))

    def receive(self, timeout_s: float) -> Readings | None:
        """Return the next readings; None while the arrays stall."""
        spec, rate_hz = self.rig.simulation, self.rig.detectors.rate_hz
        if self._number == spec.stall_at_frame and self._stall_s > 0:
            self._stall_s -= timeout_s
            return None
        while True:
            number = self._number
            self._number += 1
            if len(self._waiting) > spec.latency_frames:
                self._shown = self._waiting.pop(0)
            if number not in spec.lose_frames:
                break
        return Readings(number, self._shown[0], round(1e9 * number / rate_hz), self._read(number / rate_hz))

    def scenario_ns(self, time_ns: int) -> int:
        """Time of the scenario, ns, at a time of the arrays' clock."""
        return time_ns - round(1e9 * self.rig.simulation.begin_s)

    def true_mirror(self, time_ns: int) -> FramedMirror:
        """The mirror at a time of the arrays' clock."""
        return FramedMirror(self.scenario.mirror_at(self.scenario_ns(time_ns)), self.rig)

    def phase_at(self, time_ns: int) -> str:
        """Part of the scenario at a time of the arrays' clock."""
        return self.scenario.phase_at(self.scenario_ns(time_ns)) or ""

    def _read(self, time_s: float) -> Counts:
        spec = self.rig.simulation
        mirror = self.scenario.mirror_at(self.scenario_ns(round(1e9 * time_s)))
        if mirror != self._mirror:
            self._mirror, self._spots = mirror, self._seen(FramedMirror(mirror, self.rig))
        led, detector = self._led_gain.copy(), self._detector_gain.copy()
        since_s = time_s - spec.begin_s - spec.fault_s
        light = self._shown[1] / FULL_SCALE
        ambient, brightness = 0.0, 1.0
        if since_s >= 0:
            led[list(spec.drifting_leds)] *= max(1 + spec.drift_per_s * since_s, 0.0)
            detector[list(spec.drifting_detectors)] *= max(1 + spec.drift_per_s * since_s, 0.0)
            led[list(spec.dead_leds)] = 0.0
            detector[list(spec.dead_detectors)] = 0.0
            ambient, brightness = spec.ambient, spec.brightness
        seen = detector * (brightness * (self._spots @ (led * light)) + ambient) + self._dark
        seen += self.rig.detectors.noise * self._noise.standard_normal(seen.shape)
        if since_s >= 0:
            seen[list(spec.saturated_detectors)] = 1.0
        return np.asarray(np.clip(np.rint(seen * FULL_SCALE), 0, FULL_SCALE), np.uint16)

    def _seen(self, mirror: FramedMirror) -> Float:
        """(256, 256) share of every LED's light in every detector's reading."""
        start, direction = self._rays
        reach = -start[..., 2] / direction[..., 2]
        for _ in range(_PASSES):  # the mirror lies at z = -depth
            place = start + reach[..., None] * direction
            depth, by_x, by_y = mirror.field(place[..., 0], place[..., 1])
            short = -depth - place[..., 2]
            reach = reach + short / (direction[..., 2] + by_x * direction[..., 0] + by_y * direction[..., 1])
        place = start + reach[..., None] * direction
        _, by_x, by_y = mirror.field(place[..., 0], place[..., 1])
        normal = np.stack([by_x, by_y, np.ones_like(by_x)], axis=-1)
        into = np.sum(direction * normal, axis=-1) / np.sum(normal**2, axis=-1)
        away = direction - 2 * into[..., None] * normal
        # the pattern face: through P0, at its angle below the mirror
        angle = np.radians(self.rig.prism.pattern_angle_deg)
        sine, cosine = np.sin(angle), np.cos(angle)
        rest = -(place[..., 0] * sine + place[..., 2] * cosine) / (
            away[..., 0] * sine + away[..., 2] * cosine
        )
        end = place + rest[..., None] * away
        u, v = end[..., 0] * cosine - end[..., 2] * sine, end[..., 1]
        leds = self.rig.leds
        steps: Float = leds.pitch_mm * (np.arange(SIDE, dtype=np.float64) - (SIDE - 1) / 2)
        across = _spot(v, leds.centre_mm[1] + steps, leds.spot_mm, leds.pitch_mm) / len(_PAIRS) ** 2
        along = _spot(u, leds.centre_mm[0] + steps, leds.spot_mm, leds.pitch_mm)
        return np.asarray(np.matmul(across.transpose(0, 2, 1), along).reshape(SIDE * SIDE, SIDE * SIDE))


def _spot(at: Float, leds: Float, spot_mm: float, pitch_mm: float) -> Float:
    """(n, rays, 16) light of a row of LEDs' spots. Of all LEDs together it is about 1 everywhere."""
    scale = pitch_mm / (np.sqrt(2 * np.pi) * spot_mm)
    return np.asarray(scale * np.exp(-((at[..., None] - leds) ** 2) / (2 * spot_mm**2)))


def _rays(rig: LightArrayRig) -> tuple[Float, Float]:
    """Starts and directions (256, 16, 3) of the rays of every detector; each has as much of its light."""
    beta, length = np.radians(rig.prism.camera_angle_deg), PrismGeometry(rig.prism).length_mm
    detectors, turned = rig.detectors, 1e-3 * rig.simulation.turned_mrad
    steps = (np.arange(SIDE) - (SIDE - 1) / 2) * detectors.pitch_mm
    v, u = (part.ravel()[:, None] for part in np.meshgrid(steps, steps, indexing="ij"))
    u, v = u + detectors.centre_mm[0], v + detectors.centre_mm[1]
    across, along = (part.ravel() for part in np.meshgrid(range(4), range(4), indexing="ij"))
    u = u + detectors.aperture_mm * _PAIRS[along, 0]
    v = v + detectors.aperture_mm * _PAIRS[across, 0]
    start = np.stack([length - u * np.cos(beta), v, -u * np.sin(beta)], axis=-1)
    tilt = beta + 1e-3 * detectors.acceptance_mrad * _PAIRS[along, 1] + turned
    aside = 1e-3 * detectors.acceptance_mrad * _PAIRS[across, 1]
    direction = np.stack([-np.sin(tilt), aside + 0 * tilt, np.cos(tilt)], axis=-1)
    return start, np.broadcast_to(direction, start.shape)
