"""From pictures on the LCD to light at the camera: panel, apertures under each pixel, lens blur."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import moderngl
import numpy as np
from numpy.typing import NDArray

from zeromethod.gl import program
from zeromethod.rig.model import Rig
from zeromethod.simulation.gpu_mirror import float_texture
from zeromethod.simulation.gpu_rays import RayMap, Region
from zeromethod.simulation.gpu_target import Pass, Target
from zeromethod.simulation.response import light_of_codes

Lit = Sequence[tuple[moderngl.Texture, NDArray[np.float32]]]
"""Pictures (8-bit red, LCD size) and the share (lcd rows,) that each row gives of their light."""

TRUNCATE = 4.0
"""The lens's Gaussian is cut at so many sigmas."""


class PanelLight:
    """Light of the LCD's pixels, summed over pictures; drawn again only where something else is asked for."""

    def __init__(self, context: moderngl.Context, rig: Rig) -> None:
        self._context = context
        self._target = Target(context, (rig.display.columns, rig.display.rows), 1)
        self._pass = Pass(context, program(context, "bench_screen.vert", "bench_panel.frag"))
        self._response = float_texture(context, light_of_codes(rig.display)[None])
        self._shares = float_texture(context, np.zeros((rig.display.rows, 1)))
        self._shown: list[tuple[int, NDArray[np.float32]]] = []
        self._region = Region(0, 0, 0, 0)

    def draw(self, names: Sequence[int], lit: Lit, region: Region) -> moderngl.Texture:
        """Texture with the light of `lit` in `region`; `names` tell pictures apart for good."""
        if self._shows(names, lit) and region == self._region.joined(region):
            return self._target.texture
        box = (region.left, region.top, region.right - region.left, region.bottom - region.top)
        for number, (picture, share) in enumerate(lit):
            self._shares.write(np.ascontiguousarray(share, dtype=np.float32).tobytes())
            textures = {"picture": picture, "response": self._response, "row_share": self._shares}
            self._pass.draw(self._target, textures, add=number > 0, box=box)
        if not lit:
            self._target.clear()
        self._shown = [(name, share.copy()) for name, (_, share) in zip(names, lit, strict=True)]
        self._region = region
        return self._target.texture

    def _shows(self, names: Sequence[int], lit: Lit) -> bool:
        if len(names) != len(self._shown):
            return False
        pairs = zip(names, lit, self._shown, strict=True)
        return all(name == known and np.array_equal(share, old) for name, (_, share), (known, old) in pairs)

    def release(self) -> None:
        """Free everything."""
        for each in (self._target, self._pass, self._response, self._shares):
            each.release()


class CameraLight:
    """Light at the camera's pixels: pieces are added on the GPU, then read and blurred.

    The lens's blur runs on the CPU, where the image ends anyway: 1 ms, while two shader passes take 20 ms
    on Mesa's llvmpipe.
    """

    def __init__(self, context: moderngl.Context, rig: Rig) -> None:
        size = rig.camera.columns, rig.camera.rows
        fill = np.maximum(rig.display.fill, 1e-3)
        self._lit = 1.0 / float(fill[0] * fill[1])
        self._ambient = rig.simulation.ambient
        self._sum = Target(context, size, 1)
        light = program(
            context, "bench_screen.vert", "bench_light.frag", RGB=int(rig.display.stripes == "rgb"), VARIANT=int(__import__("os").environ["VAR"]), PSF_ON=1, PSF=rig.camera.psf_px, **_poly()
        )
        self._light = Pass(context, light, {"fill": fill})
        self._blur = LensBlur(rig.camera.psf_px, size[::-1])

    def start(self) -> None:
        """Forget the last exposure; only the ambient light is there."""
        self._sum.clear(self._ambient)

    def add(self, ray_map: RayMap, panel: moderngl.Texture) -> None:
        """Add what the panel gives by way of one ray map."""
        textures = {"rays": ray_map.rays.texture, "footprints": ray_map.footprints.texture, "panel": panel}
        self._light.draw(self._sum, textures, {"scale": ray_map.share * self._lit}, add=True)

    def read(self) -> NDArray[np.float32]:
        """(rows, cols) float32, blurred; the array is used again by the next call."""
        return self._sum.read()

    def release(self) -> None:
        """Free everything."""
        self._sum.release()
        self._light.release()


class LensBlur:
    """Gaussian of `sigma_px` over images of `shape`, normalised over what lies in the image."""

    def __init__(self, sigma_px: float, shape: tuple[int, int]) -> None:
        radius = int(TRUNCATE * sigma_px + 0.5)
        self._kernel = np.ones(1)
        if radius > 0:
            self._kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma_px) ** 2)
            self._kernel /= self._kernel.sum()
        self._blurred = np.empty(shape, dtype=np.float32)
        self._gain = 1.0 / self._convolved(np.ones(shape, dtype=np.float32))

    def __call__(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        """Blurred image; the array is used again by the next call."""
        if len(self._kernel) == 1:
            return image
        self._convolved(image)
        self._blurred *= self._gain
        return self._blurred

    def _convolved(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        kernel, border = self._kernel, cv2.BORDER_CONSTANT
        cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel, dst=self._blurred, borderType=border)
        return self._blurred


def _poly():
    from scipy.special import ndtr
    Z=4.25
    p=np.polynomial.Chebyshev.interpolate(lambda z:np.exp(-z*z/2)/np.sqrt(2*np.pi)-z*ndtr(-z),9,[0,Z])
    c=np.polynomial.Chebyshev(p.coef,[-1,1]).convert(kind=np.polynomial.Polynomial).coef
    e=f"{c[-1]:.9g}"
    for x in c[-2::-1]: e=f"({e}*t+({x:.9g}))"
    return {"TAIL_END":Z,"TAIL_POLYNOMIAL":e}
