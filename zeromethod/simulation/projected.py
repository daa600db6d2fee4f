"""A projector on the simulated bench: its picture on the cloth, and what of that reaches the camera.

Threads that touch the mirror send light into the rubber in all directions, the camera's as well; from the
others it comes within the critical angle, which total reflection keeps from the camera. So the picture is
seen on threads, through the mirror where a slope ends total reflection, and in the same two ways where what
the pattern face and the LCD's glass send back meets the mirror again.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.clock import Clock
from zeromethod.errors import InputError
from zeromethod.interactive.homography import mapped, mm_to_px
from zeromethod.optics import Dented, Optics, reflect
from zeromethod.rig.model import ProjectorSpec, Rig
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.surroundings import at_face, sent_back_share
from zeromethod.simulation.timeline import Timeline

_PHASE = 0.37
"""Of the projector's refreshes, which nothing holds to the LCD's."""
_KEPT_NS = 1_000_000_000
"""How long a picture is kept after its last light."""


def threads_view(rig: Rig) -> float:
    """Light that a thread in contact sends to the camera, of its luminance in air."""
    return 1 / rig.prism.index**2


def true_map(rig: Rig) -> Float:
    """(3, 3) from the mirror, mm, to the projector's pixels, as the bench truly has it."""
    if rig.projector is None:
        raise InputError("projector: missing: a table [projector]")
    return mm_to_px(rig.projector, rig.simulation.projector_off_mm)


class Way(NamedTuple):
    """One way to the camera, per pixel: places on the mirror (rows, cols, 2) mm, and share (rows, cols)."""

    place_mm: Float
    share: Float


class ProjectedWays:
    """The numpy model of bench_projected.frag."""

    def __init__(self, rig: Rig) -> None:
        self._rig, self._optics = rig, Optics(rig)
        v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(np.float64)
        self._rays = self._optics.rubber_rays(u, v)
        self._back, self._threads = sent_back_share(rig), threads_view(rig)

    def ways(self, mirror: Mirror) -> tuple[Way, Way]:
        """The direct way, and that of what is sent back."""
        direct, point, outgoing, kept = self._meet(*self._rays, mirror)
        face = self._optics.prism.pattern_face
        again, *_ = self._meet(at_face(face, point, outgoing), reflect(outgoing, face.normal), mirror)
        share = np.nan_to_num(self._back * kept * again.share)
        return direct, again._replace(share=share)

    def light(self, mirror: Mirror, picture: Single) -> Single:
        """(rows, cols) light at the camera of a picture's luminance on the cloth (projector rows, cols)."""
        to_px = true_map(self._rig)
        total = np.zeros((self._rig.camera.rows, self._rig.camera.columns), np.float32)
        for way in self.ways(mirror):
            px = mapped(to_px, np.nan_to_num(way.place_mm, nan=1e6)).astype(np.float32)
            last = np.array(picture.shape[::-1], np.float32) - 1
            inside = ((px >= -0.5) & (px <= last + 0.5)).all(axis=-1)
            px = np.clip(px, 0, last)
            there = np.asarray(cv2.remap(picture, px[..., 0], px[..., 1], cv2.INTER_LINEAR))
            total += np.where(inside, there * way.share, 0.0).astype(np.float32)
        return total

    def _meet(self, origin: Float, direction: Float, mirror: Mirror) -> tuple[Way, Float, Float, Float]:
        """(what is seen on the mirror, point, direction after it, share reflected)."""
        optics = self._optics
        surface = Dented(optics.rest, mirror) if mirror.dents else optics.rest
        point, outgoing, cosine, reflectance = optics.reflected(origin, direction, surface)
        x, y = point[..., 0], point[..., 1]
        taken = mirror.threads(x, y)
        left = mirror.light(x, y, cosine, optics.rig.prism.index)[0]
        on = optics.prism.on_mirror(x, y) & np.isfinite(reflectance)
        seen = np.where(on, self._threads * taken + (1 - reflectance) * left, 0.0)
        return Way(point[..., :2], seen), point, outgoing, np.where(on, reflectance * left, 0.0)


class SimulatedProjector:
    """A projector that shows each picture from its own next refresh on; black before the first."""

    trouble = ""

    def __init__(self, spec: ProjectorSpec, clock: Clock) -> None:
        self._spec, self._clock = spec, clock
        self._refreshes = Timeline(spec.refresh_hz, _PHASE)
        self._latency_ns = round(1e9 * spec.latency_s)
        self._light = (spec.brightness * (np.arange(256) / 255) ** spec.gamma).astype(np.float32)
        self._shown: list[tuple[int, Single]] = []

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows), px."""
        return self._spec.columns, self._spec.rows

    def show(self, picture: Bytes) -> None:
        """Show grey codes (rows, cols) from the next refresh on, without waiting for it."""
        if picture.shape != self.size[::-1] or picture.dtype != np.uint8:
            raise InputError(f"picture: {picture.shape} {picture.dtype}: allowed is {self.size[::-1]} uint8")
        now_ns = self._clock.now_ns()
        swap_ns = self._refreshes.time_ns(self._refreshes.first_after(now_ns)) + self._latency_ns
        if self._shown and self._shown[-1][0] == swap_ns:
            self._shown.pop()
        self._shown.append((swap_ns, self._light[picture]))
        while len(self._shown) > 1 and self._shown[1][0] < now_ns - _KEPT_NS:
            self._shown.pop(0)

    def luminance(self, from_ns: int, to_ns: int) -> Single | None:
        """(rows, cols) mean luminance on the cloth in an exposure, white LCD 1; None for none."""
        ends = [*(time_ns for time_ns, _ in self._shown), to_ns][1:]
        parts = []
        for (start_ns, light), end_ns in zip(self._shown, ends, strict=True):
            lasted = min(end_ns, to_ns) - max(start_ns, from_ns)
            if lasted > 0:
                parts.append((lasted / (to_ns - from_ns), light))
        if not parts:
            return None
        if len(parts) == 1 and parts[0][0] == 1:
            return parts[0][1]  # the same array, which need not be uploaded again
        return np.asarray(sum(np.float32(share) * light for share, light in parts), np.float32)

    def poll(self) -> None:
        """Nothing is to be done in between."""

    def close(self) -> None:
        """Nothing is to be freed."""
