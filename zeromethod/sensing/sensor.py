"""The sensor that the loop holds: image in, residual out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.errors import InputError
from zeromethod.rig.model import Noise, Rig
from zeromethod.sensing.carrier import CarrierEstimator
from zeromethod.sensing.demodulate import Image
from zeromethod.sensing.gradient import GradientEstimator
from zeromethod.sensing.levelling import level, noise_factor
from zeromethod.sensing.residual import Limits, Residual
from zeromethod.sensing.shading import flag_light_edges
from zeromethod.sensing.unwrap import Unwrapper
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.validity import Flag

_OUTSIDE = np.uint16(Flag.OUTSIDE)

Light = Callable[[Float, Float], Float]
"""The target's light at camera pixels (u, v), as `Target.light` gives it."""

CARRIER_KINDS = ("cosines", "checker", "lattice")


def carrier_origin(kind: str, period_px: int, light: Light | None) -> tuple[float, float]:
    """Phases (rad) of the target's two carriers at pixel (0, 0), from one period of its light.

    Zero without `light`: cosines and checkers that are bright at (0, 0).
    """
    if light is None:
        return 0.0, 0.0
    v, u = np.mgrid[:period_px, :period_px].astype(float)
    spectrum = np.fft.fft2(light(u, v))
    if kind == "checker":
        return float(np.angle(spectrum[1, 1])), float(np.angle(spectrum[-1, 1]))
    return float(np.angle(spectrum[0, 1])), float(np.angle(spectrum[1, 0]))


def contiguous(image: Image) -> Image:
    """Image itself where its memory is in order, else a copy."""
    return image if image.flags.c_contiguous else image.copy()


class ResidualSensor:
    """Measures the residual of images of one shape against one target.

    grid: its `image_shape` and `period_px` are the image's and the target's. kind: cosines, checker,
    lattice (demodulated; any displacement, by unwrapping) or noise (one Gauss-Newton step, near null
    only). bits: camera's; grey 2^bits - 1 counts as clipped. light: the target's light per camera pixel
    (`Target.light`); needed for noise and lattice. covered: (rows, cols) nodes to leave alone, where
    something else than the target is drawn; they count as OUTSIDE.

    Buffers are made here and kept; the constructor also compiles. One sensor serves one thread.
    """

    def __init__(
        self,
        grid: NodeGrid,
        kind: str,
        noise: Noise,
        bits: int,
        *,
        light: Light | None = None,
        limits: Limits | None = None,
        covered: Mask | None = None,
    ) -> None:
        if kind not in (*CARRIER_KINDS, "noise"):
            raise InputError(f"target.kind: {kind!r}: one of cosines, checker, lattice, noise")
        if light is None and kind in {"lattice", "noise"}:
            raise InputError(f"ResidualSensor: light: None: target.kind {kind!r} needs the target's light")
        if min(grid.shape) <= 2 * PADDING:
            raise InputError(f"ResidualSensor: grid: {grid}: the image must be larger than 2 periods")
        self.grid, self.kind, self.bits = grid, kind, bits
        limits = limits or Limits()
        ceiling = 2**bits - 1
        self._estimator: CarrierEstimator | GradientEstimator
        if kind == "noise" and light is not None:
            self._estimator = GradientEstimator(grid, noise, ceiling, limits, light)
            self._unwrapper = None
        else:
            self._estimator = CarrierEstimator(
                grid,
                noise,
                ceiling,
                limits,
                diagonal=kind == "checker",
                origin_rad=carrier_origin(kind, grid.period_px, light),
            )
            self._unwrapper = Unwrapper(grid, diagonal=kind == "checker")
        self._noise, self._black, self._ceiling = noise, noise.black_grey, ceiling
        self._levelled: Single | None = None
        self._covered = np.flatnonzero(covered) if covered is not None else np.zeros(0, np.intp)
        rows, cols = (axis[PADDING:-PADDING].astype(np.intp) for axis in (grid.v_px, grid.u_px))
        self._node_pixels = np.ix_(rows, cols)
        self._out = Residual.empty(grid)
        self._reference_light = np.zeros([n - 2 * PADDING for n in grid.shape], np.float32)
        self._bent = np.zeros(grid.shape[0], np.uint8)
        blank = np.zeros(grid.image_shape, np.uint16)
        self.measure(blank.astype(np.uint8) if bits <= 8 else blank)

    @classmethod
    def from_rig(
        cls, rig: Rig, grid: NodeGrid, light: Light | None = None, covered: Mask | None = None
    ) -> ResidualSensor:
        """Sensor for a rig's camera and target."""
        return cls(grid, rig.target.kind, rig.camera.noise, rig.camera.bits, light=light, covered=covered)

    def set_reference(self, residual: Residual | None) -> None:
        """Take the brightness at rest from a residual; from then on LIGHT_LOST is judged. None forgets.

        Nodes that have no carrier at rest get no reference.
        """
        self._reference_light[:] = 0.0
        if residual is None:
            return
        inner = self.grid.inner
        lit = residual.flags[inner] & Flag.MODULATION == 0
        light = np.maximum(residual.mean[inner] - self._black, 0.0)
        self._reference_light[lit] = light[lit]

    def measure(
        self,
        image: Image,
        guess: Float | None = None,
        out: Residual | None = None,
        *,
        light_share: Single | None = None,
    ) -> Residual:
        """Residual of one image (rows, cols), uint8 or uint16.

        guess: (rows, cols, 2) px expected displacement per node, NaN = none; settles the carrier's order
        of regions that are cut off from the border of the view. out: buffers of `Residual.empty(grid)`;
        without it the result lives in the sensor's own and is overwritten by the next call.
        light_share: (rows, cols) of the image, light that its pixels should see over that at rest; taken out
        of the image first, so that mean, modulation and all rules about light are those at rest's light,
        while sigma stays that of the image as it was taken. None = the light should be as at rest.

        After a displacement that varies much over +-P px the result is a first estimate (the window's
        average, `window.curvature_bias_px2`); the loop shows the new warp and measures again.
        """
        if image.shape != self.grid.image_shape or image.dtype not in (np.uint8, np.uint16):
            raise InputError(
                f"image: {image.shape} {image.dtype}: {self.grid.image_shape} of uint8 or uint16"
            )
        out = out or self._out
        image = contiguous(image)
        if light_share is not None:
            image = self._level(image, light_share)
        self._estimator.estimate(image, self._reference_light, out)
        out.flags.reshape(-1)[self._covered] |= _OUTSIDE
        if light_share is not None:
            inner = self.grid.inner
            factor = noise_factor(out.mean[inner], light_share[self._node_pixels], self._noise)
            out.sigma[inner] *= factor[..., None]
        if self._unwrapper is not None:
            period = float(self.grid.period_px)
            flag_light_edges(out.mean, out.modulation, out.d, out.flags, self._black, period, self._bent)
            self._unwrapper.unwrap(out, guess)
        return out

    def _level(self, image: Image, light_share: Single) -> Single:
        """`image` at rest's light, in the sensor's own buffer."""
        if self._levelled is None:
            self._levelled = np.empty(self.grid.image_shape, np.float32)
        level(image, light_share, self._black, self._ceiling, self._levelled)
        return self._levelled
