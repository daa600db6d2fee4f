"""Ray maps of mirrors, traced by bench_rays.frag and kept as long as the mirror stays the same."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any, NamedTuple

import moderngl
import numpy as np

from zeromethod.gl import float_texture, program
from zeromethod.rig.model import Rig
from zeromethod.simulation.beams import scattered_view
from zeromethod.simulation.cloth import cloth_of
from zeromethod.simulation.gpu_bench import bench_defines, bench_values, mirror_middle_mm
from zeromethod.simulation.gpu_lens import reach_px
from zeromethod.simulation.gpu_mirror import (
    acting_dents,
    map_texture,
    mirror_defines,
    mirror_values,
    rest_code,
    rest_texture,
    rest_values,
)
from zeromethod.simulation.gpu_pupil import GpuPupil
from zeromethod.simulation.gpu_target import RenderTarget, ShaderPass, constants
from zeromethod.simulation.gpu_touch import cloth_values, level_texture, touch_values
from zeromethod.simulation.press import Dent, Mirror
from zeromethod.simulation.projected import threads_view
from zeromethod.simulation.surroundings import sent_back_share

KEPT = 3
"""Mirrors whose maps are kept: rest, and the two instants of an exposure while a press moves."""
NEWTON_STEPS = 12
"""From the plane z = 0 to the mirror; three do for smooth dents."""
MOST_FACES = 12
"""Of a saw's teeth and the mirror that a ray may meet after the first; light of more is next to none."""
_BLOCK = 16
_SCATTERED, _SENT_BACK = -1, -2
"""Instead of a beam: the light that objects scatter; what the pattern's side sends back of a cloth's."""


class LcdRegion(NamedTuple):
    """LCD px, columns and rows from (included) to (not included)."""

    left: int
    top: int
    right: int
    bottom: int

    def joined(self, other: LcdRegion) -> LcdRegion:
        """Smallest region that contains both."""
        return LcdRegion(
            min(self.left, other.left),
            min(self.top, other.top),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
        )


@dataclass(slots=True)
class RayMap:
    """What every camera pixel sees by way of one mirror.

    rays: RGBA32F (q column, q row, reflectance, 1 where the ray arrives). footprints: RGBA32F (dq/du, dq/dv).
    share: light relative to the main map. region: the LCD's part that any pixel gets light from.
    scattered: R32F light, 1 = the LCD's mean, that objects in contact scatter; None where nothing touches.
    With a cloth it goes on with x, y mm, share of the projected light, and `sent_back` has these of the
    second way.
    """

    rays: RenderTarget
    footprints: RenderTarget
    share: float
    region: LcdRegion
    scattered: RenderTarget | None = None
    sent_back: RenderTarget | None = None

    def release(self) -> None:
        """Free the textures."""
        self.rays.release()
        self.footprints.release()
        for each in (self.scattered, self.sent_back):
            if each is not None:
                each.release()


class RayTracer:
    """Traces mirrors; the last `KEPT` are kept."""

    def __init__(self, context: moderngl.Context, rig: Rig) -> None:
        self._context = context
        self._rig = rig
        self._middle_mm = mirror_middle_mm(rig.prism)
        self._constants = constants(bench_values(rig) | rest_values(rig.prism.rest, self._middle_mm))
        self._rest = rest_texture(context, rig.prism.rest)
        self._cloth = cloth_of(rig)
        self._weave = None if self._cloth is None else float_texture(context, self._cloth.weave)
        self._passes: dict[tuple[object, ...], ShaderPass] = {}
        self._footprint, self._wide_footprint = (
            ShaderPass(context, program(context, "bench_screen.vert", "bench_footprint.frag", PUPIL=pupil))
            for pupil in (0, 1)
        )
        bounds = program(context, "bench_screen.vert", "bench_bounds.frag", BLOCK=_BLOCK)
        self._bounds = ShaderPass(context, bounds, {"reach": reach_px(rig.camera.psf_px)})
        size = rig.camera.columns, rig.camera.rows
        self._size = size
        self._tiles = RenderTarget(context, (-(-size[0] // _BLOCK), -(-size[1] // _BLOCK)), 4)
        self._kept: OrderedDict[Mirror, list[RayMap]] = OrderedDict()
        simulation = rig.simulation
        ghosts = ((1, simulation.ghost_gap), (2, simulation.ghost_faces))
        self._ways = [(0, 1.0), *((way, share) for way, share in ghosts if share > 0)]
        self._scratch: list[RenderTarget] = []
        self._pupil = GpuPupil(context, rig) if rig.camera.pupil_mm > 0 else None
        if self._pupil is not None:
            self._scratch = [RenderTarget(context, size, 4) for _ in range(2)]
            self._at_rest = [RenderTarget(context, size, 4) for _ in self._ways]
            for (way, _), rays in zip(self._ways, self._at_rest, strict=True):
                self._trace(Mirror(), way, rays, {"rest_map": self._rest})
            self._scratch += self._at_rest

    def maps(self, mirror: Mirror) -> list[RayMap]:
        """Ray maps of `mirror`: the main one, then those of the ghosts that the rig has."""
        kept = self._kept.pop(mirror, None)
        if kept is None:
            spare = self._kept.popitem(last=False)[1] if len(self._kept) == KEPT else self._empty()
            kept = self._traced(mirror, spare)
        self._kept[mirror] = kept
        return kept

    def seen_px2(self) -> float:
        """What a camera pixel sees of the LCD at rest, median, LCD px^2."""
        ray_map = self.maps(Mirror())[0]
        arrives, foot = ray_map.rays.read()[..., 3] > 0, ray_map.footprints.read()
        return float(np.median(np.abs(foot[..., 0] * foot[..., 3] - foot[..., 1] * foot[..., 2])[arrives]))

    def release(self) -> None:
        """Free everything."""
        for maps in self._kept.values():
            for ray_map in maps:
                ray_map.release()
        self._kept.clear()
        for each in (
            *self._passes.values(),
            self._footprint,
            self._wide_footprint,
            self._bounds,
        ):
            each.release()
        for target in self._scratch:
            target.release()
        if self._pupil is not None:
            self._pupil.release()
        self._tiles.release()
        self._passes.clear()
        for texture in (self._rest, self._weave):
            if texture is not None:
                texture.release()
        self._rest = self._weave = None

    def _empty(self) -> list[RayMap]:
        context, size = self._context, self._size
        nothing = LcdRegion(0, 0, 0, 0)
        return [
            RayMap(RenderTarget(context, size, 4), RenderTarget(context, size, 4), share, nothing)
            for _, share in self._ways
        ]

    def _traced(self, mirror: Mirror, maps: list[RayMap]) -> list[RayMap]:
        levels = level_texture(self._context, mirror.touches)
        texture = map_texture(self._context, acting_dents(mirror))
        samplers = {"dent_maps": texture, "rest_map": self._rest, "touch_levels": levels}
        samplers |= {"cloth_weave": self._weave}
        for number, ((way, _), ray_map) in enumerate(zip(self._ways, maps, strict=True)):
            if self._pupil is None or not mirror.dents:
                self._trace(mirror, way, ray_map.rays, samplers)
                self._footprint.draw(ray_map.footprints, {"rays": ray_map.rays.texture})
            else:
                single, spread = self._scratch[:2]
                self._trace(mirror, way, single, samplers)
                self._pupil.draw(single, self._at_rest[number], ray_map.rays, spread)
                textures = {"rays": ray_map.rays.texture, "spread": spread.texture}
                self._wide_footprint.draw(ray_map.footprints, textures)
            ray_map.region = self._region(ray_map)
        self._scatter(mirror, maps[0], samplers)
        for each in (texture, levels):
            if each is not None:
                each.release()
        return maps

    def _trace(
        self, mirror: Mirror, way: int, rays: RenderTarget, samplers: dict[str, moderngl.Texture | None]
    ) -> None:
        dents = acting_dents(mirror)
        values = mirror_values(dents, self._middle_mm) | touch_values(mirror.touches, self._middle_mm)
        if self._cloth is not None:
            values |= cloth_values(self._cloth, self._middle_mm)
        self._pass(dents, len(mirror.touches), way).draw(rays, samplers, values)

    def _scatter(self, mirror: Mirror, ray_map: RayMap, samplers: dict[str, moderngl.Texture | None]) -> None:
        """Have the map know what objects scatter."""
        for each in (ray_map.scattered, ray_map.sent_back):
            if each is not None:
                each.release()
        ray_map.scattered = ray_map.sent_back = None
        if self._cloth is not None:
            ray_map.scattered, ray_map.sent_back = (RenderTarget(self._context, self._size, 4) for _ in "12")
            self._trace(mirror, _SCATTERED, ray_map.scattered, samplers)
            self._trace(mirror, _SENT_BACK, ray_map.sent_back, samplers)
            return
        if not mirror.touches:
            return
        light = RenderTarget(self._context, self._size, 1)
        self._trace(mirror, _SCATTERED, light, samplers)
        if self._pupil is not None:
            mean = RenderTarget(self._context, self._size, 1)
            self._pupil.draw_light(light, mean)
            light.release()
            light = mean
        ray_map.scattered = light

    def _pass(self, dents: tuple[Dent, ...], touches: int, way: int) -> ShaderPass:
        key = (way, touches, *(dent.shape for dent in dents))
        if key not in self._passes:
            defines: dict[str, Any] = {
                "RIG": self._constants,
                "GHOST": max(way, 0),
                "SCATTERED": {_SCATTERED: 1, _SENT_BACK: 2}.get(way, 0),
                "SCATTERED_VIEW": scattered_view(self._rig.prism),
                "THREADS_VIEW": threads_view(self._rig),
                "SENT_BACK": sent_back_share(self._rig),
                "CLOTH": int(self._cloth is not None),
                "TOUCHES": touches,
                "REST": rest_code(self._rig.prism.rest),
                **bench_defines(self._rig),
                **mirror_defines(dents),
            }
            made = program(self._context, "bench_screen.vert", "bench_rays.frag", **defines)
            steps = {"newton_steps": NEWTON_STEPS}
            if self._rig.prism.teeth is not None and way >= 0:
                steps["most_faces"] = MOST_FACES
            self._passes[key] = ShaderPass(self._context, made, steps)
        return self._passes[key]

    def _region(self, ray_map: RayMap) -> LcdRegion:
        samplers = {"rays": ray_map.rays.texture, "footprints": ray_map.footprints.texture}
        self._bounds.draw(self._tiles, samplers)
        tiles = self._tiles.read()
        low = np.floor(tiles[..., :2].min(axis=(0, 1)) + 0.5)
        high = np.floor(tiles[..., 2:].max(axis=(0, 1)) + 0.5) + 1
        display = self._rig.display
        low = np.clip(low, 0, (display.columns - 1, display.rows - 1)).astype(int)
        high = np.clip(high, low + 1, (display.columns, display.rows)).astype(int)
        return LcdRegion(int(low[0]), int(low[1]), int(high[0]), int(high[1]))
