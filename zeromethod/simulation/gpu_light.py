"""From pictures on the LCD to light at the camera: panel, then what each pixel gathers from its apertures."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np

from zeromethod.arrays import Float, Single
from zeromethod.gl import float_texture, program
from zeromethod.pattern.response import Response
from zeromethod.rig.model import Rig
from zeromethod.simulation.beams import MOST_FOCUS
from zeromethod.simulation.gpu_lens import lens_defines
from zeromethod.simulation.gpu_projected import ProjectedLight
from zeromethod.simulation.gpu_rays import LcdRegion, RayMap
from zeromethod.simulation.gpu_target import RenderTarget, ShaderPass

Lit = Sequence[tuple[moderngl.Texture, Float]]
"""Pictures (8-bit red, LCD size) and the share (lcd rows,) that each row gives of their light."""


class PanelLight:
    """Light of the LCD's pixels, summed over pictures; drawn again only where something else is asked for."""

    def __init__(self, context: moderngl.Context, rig: Rig) -> None:
        self._context = context
        size = rig.display.columns, rig.display.rows
        self._sum = RenderTarget(context, size, 1)
        self._five = RenderTarget(context, size, 4, "u4")
        response = Response.from_rig(rig.display)
        regions = response.exponent is not None
        shader = program(context, "bench_screen.vert", "bench_panel.frag", REGIONS=int(regions))
        self._pass = ShaderPass(context, shader)
        self._packing = ShaderPass(context, program(context, "bench_screen.vert", "bench_five.frag"))
        self._fixed = {"response": float_texture(context, response.light(np.arange(256))[None])}
        if regions:
            self._fixed["exponents"] = float_texture(
                context, response.exponents((rig.display.rows, rig.display.columns))
            )
        self._shares = float_texture(context, np.zeros((rig.display.rows, 1)))
        self._shown: list[tuple[int, Float]] = []
        self._region = LcdRegion(0, 0, 0, 0)
        self._mean: float | None = None

    def mean(self) -> float:
        """Mean light of the whole panel, which was drawn last."""
        if self._mean is None:
            self._mean = float(self._sum.read().mean())
        return self._mean

    def draw(self, names: Sequence[int], lit: Lit, region: LcdRegion) -> moderngl.Texture:
        """Texture with the light of `lit` in `region`, as bench_five.frag packs it.

        Texel (i, j) holds columns i to i + 4 of row j; beyond the panel they are dark. `names` identify
        pictures for good.
        """
        if self._shows(names, lit) and region == self._region.joined(region):
            return self._five.texture
        box = (region.left, region.top, region.right - region.left, region.bottom - region.top)
        for number, (picture, share) in enumerate(lit):
            self._shares.write(np.ascontiguousarray(share, dtype=np.float32).tobytes())
            textures = {"picture": picture, "row_share": self._shares, **self._fixed}
            self._pass.draw(self._sum, textures, add=number > 0, box=box)
        if not lit:
            self._sum.clear()
        self._packing.draw(self._five, {"light": self._sum.texture}, box=box)
        self._mean = None
        self._shown = [(name, share.copy()) for name, (_, share) in zip(names, lit, strict=True)]
        self._region = region
        return self._five.texture

    def _shows(self, names: Sequence[int], lit: Lit) -> bool:
        if len(names) != len(self._shown):
            return False
        pairs = zip(names, lit, self._shown, strict=True)
        return all(name == known and np.array_equal(share, old) for name, (_, share), (known, old) in pairs)

    def release(self) -> None:
        """Free everything."""
        for each in (self._sum, self._five, self._pass, self._packing):
            each.release()
        for texture in (self._shares, *self._fixed.values()):
            texture.release()


class CameraLight:
    """Light at the camera's pixels: pieces are added on the GPU, then read.

    Lens and pixel act in one: the image is blurred before it is sampled. Reflectance is taken at the pixel's
    centre, so that it alone is not blurred: a contact's border is as sharp as a pixel.

    lamp_px2: where a lamp at the camera lights the pattern, what a pixel sees of it where it is as bright as
    an LCD would be, LCD px^2; 0 for the LCD's own light.
    """

    def __init__(self, context: moderngl.Context, rig: Rig, lamp_px2: float = 0.0) -> None:
        fill = [max(float(share), 1e-3) for share in rig.display.fill_factor]
        self._ambient = rig.simulation.ambient
        self._sum = RenderTarget(context, (rig.camera.columns, rig.camera.rows), 1)
        defines = {
            "RGB": int(rig.display.stripes == "rgb"),
            "FILL_X": fill[0],
            "FILL_Y": fill[1],
            "LAMP": int(lamp_px2 > 0.0),
            "LAMP_PX2": lamp_px2,
            "MOST_FOCUS": MOST_FOCUS,
            **lens_defines(rig.camera.psf_px),
        }
        light = program(context, "bench_screen.vert", "bench_light.frag", **defines)
        self._light = ShaderPass(context, light)
        self._scatter = ShaderPass(context, program(context, "bench_screen.vert", "bench_scatter.frag"))
        self._projected = ProjectedLight(context, rig) if rig.projector is not None else None

    def start(self) -> None:
        """Forget the last exposure; only the ambient light is there."""
        self._sum.clear(self._ambient)

    def add(self, ray_map: RayMap, panel: moderngl.Texture) -> None:
        """Add what the panel gives by way of one ray map."""
        textures = {"rays": ray_map.rays.texture, "footprints": ray_map.footprints.texture, "panel": panel}
        self._light.draw(self._sum, textures, {"scale": ray_map.share}, add=True)

    def add_scattered(self, scattered: RenderTarget, light: float) -> None:
        """Add what objects scatter; `light`: of the panel, its mean, times the share of the exposure."""
        self._scatter.draw(self._sum, {"scattered": scattered.texture}, {"scale": light}, add=True)

    def add_projected(self, ray_map: RayMap, luminance: Single, share: float) -> None:
        """Add what a projector's picture on the cloth gives; share: of the exposure."""
        if self._projected is not None:
            self._projected.draw(self._sum, (ray_map.scattered, ray_map.sent_back), luminance, share)

    def read(self) -> Single:
        """(rows, cols) float32; the array is used again by the next call."""
        return self._sum.read()

    def release(self) -> None:
        """Free everything."""
        self._sum.release()
        self._light.release()
        self._scatter.release()
        if self._projected is not None:
            self._projected.release()
