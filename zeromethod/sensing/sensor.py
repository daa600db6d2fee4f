"""What turns camera images into residuals: the protocol, and the sensor of all targets."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.errors import InputError
from zeromethod.rig.model import Noise, Rig
from zeromethod.sensing.carrier import CarrierEstimator, take_out
from zeromethod.sensing.gradient import GradientEstimator, Light
from zeromethod.sensing.residual import Limits, Residual
from zeromethod.sensing.shading import flag_light_edges, level, noise_factor
from zeromethod.sensing.unwrap import Unwrapper
from zeromethod.warp.grid import PADDING, NodeGrid
from zeromethod.warp.validity import Flag

_OUTSIDE = np.uint16(Flag.OUTSIDE)


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


class Sensor(Protocol):
    """What turns an image into the residual."""

    def measure(
        self,
        image: Image,
        guess: Float | None = None,
        continued: Float | None = None,
        *,
        light_share: Single | None = None,
        target_rad: Float | None = None,
    ) -> Residual:
        """Residual of a (rows, cols) image; guess: (rows, cols, 2) px expected, NaN = none.

        continued: the same of all nodes. light_share: (rows, cols) of the image, light expected over that at
        rest; None = as at rest.
        target_rad: (rows, cols, 2) known phase of the target along its two carriers; None = 0.
        """

    def set_reference(self, residual: Residual | None) -> None:
        """Take the brightness to hold later frames against from a residual; None forgets."""

    def scale_reference(self, ratio: float) -> None:
        """Expect this many times the light, as of another exposure."""


class ResidualSensor:
    """Sensor of the residual of images of one shape against one target.

    Buffers are reused: one sensor serves one thread.

    Parameters
    ----------
    grid : NodeGrid
        Nodes; its `image_shape` and `period_px` are the image's and the target's.
    kind : str
        "cosines", "checker", "lattice" (demodulated and unwrapped: any displacement) or "noise" (one
        Gauss-Newton step: near null only).
    noise : Noise
        Of the camera.
    bits : int
        Of the camera; grey 2^bits - 1 counts as clipped.
    light : callable, optional
        The target's light at camera pixels (u, v) (`Target.light`); needed for noise and lattice.
    covered : (rows, cols) bool, optional
        Nodes where something else than the target is drawn; they count as OUTSIDE.

    Raises
    ------
    InputError
        For another kind, a missing `light`, or an image of 2 periods or less.
    """

    def __init__(
        self,
        grid: NodeGrid,
        kind: str,
        noise: Noise,
        bits: int,
        *,
        light: Light | None = None,
        covered: Mask | None = None,
        parted: bool = False,
    ) -> None:
        if kind not in {"cosines", "checker", "lattice", "noise"}:
            raise InputError(f"target.kind: {kind!r}: one of cosines, checker, lattice, noise")
        if light is None and kind in {"lattice", "noise"}:
            raise InputError(f"ResidualSensor: light: None: target.kind {kind!r} needs the target's light")
        if min(grid.shape) <= 2 * PADDING:
            raise InputError(f"ResidualSensor: grid: {grid}: the image must be larger than 2 periods")
        self.grid, self.kind, self.bits = grid, kind, bits
        limits, ceiling = Limits(), 2**bits - 1
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
            self._unwrapper = Unwrapper(grid, diagonal=kind == "checker", parted=parted)
        self._noise, self._black, self._ceiling = noise, noise.black_grey, ceiling
        self._levelled: Single | None = None
        self._covered = np.flatnonzero(covered) if covered is not None else np.zeros(0, np.intp)
        rows, cols = (axis[PADDING:-PADDING].astype(np.intp) for axis in (grid.v_px, grid.u_px))
        self._node_pixels = np.ix_(rows, cols)
        self._out = Residual.empty(grid)
        self._reference_light = np.zeros([n - 2 * PADDING for n in grid.shape], np.float32)

    @classmethod
    def from_rig(
        cls, rig: Rig, grid: NodeGrid, light: Light | None = None, covered: Mask | None = None
    ) -> ResidualSensor:
        """Sensor for a rig's camera and target."""
        parted = rig.prism.teeth is not None
        return cls(
            grid,
            rig.target.kind,
            rig.camera.noise,
            rig.camera.bits,
            light=light,
            covered=covered,
            parted=parted,
        )

    def set_reference(self, residual: Residual | None) -> None:
        """Set the brightness at rest, against which LIGHT_LOST is judged, from a residual; None forgets it.

        Nodes without a carrier at rest get no reference.
        """
        self._reference_light[:] = 0.0
        if residual is None:
            return
        inner = self.grid.inner
        lit = residual.flags[inner] & Flag.MODULATION == 0
        light = np.maximum(residual.mean[inner] - self._black, 0.0)
        self._reference_light[lit] = light[lit]

    def scale_reference(self, ratio: float) -> None:
        """Expect this many times the light, as of another exposure."""
        self._reference_light *= np.float32(ratio)

    def measure(
        self,
        image: Image,
        guess: Float | None = None,
        continued: Float | None = None,
        out: Residual | None = None,
        *,
        light_share: Single | None = None,
        target_rad: Float | None = None,
    ) -> Residual:
        """Residual of one image.

        After a displacement that varies much over +-P px the result is a first estimate (the window's
        average, `window.curvature_bias_px2`); the loop shows the new warp and measures again.

        Parameters
        ----------
        image : (image rows, image cols) uint8 or uint16
            Grey levels.
        guess : (rows, cols, 2), optional
            Expected displacement per node, px, NaN = none; determines the carrier's order in regions that
            are cut off from the border of the view.
        continued : (rows, cols, 2), optional
            The guess, continued to nodes that have none; steps from node to node are held against its.
        out : Residual, optional
            Receives the result; without it the result is overwritten by the next call.
        light_share : (image rows, image cols), optional
            Expected light of every pixel over that at rest, which is divided out first: mean, modulation and
            all rules about light refer to the light at rest, sigma to the image as taken.
        target_rad : (rows, cols, 2), optional
            Known phase of a moving target along its two carriers (`exposure.target_phase`), which is taken
            out of theirs; not for noise, which has none.

        Returns
        -------
        Residual

        Raises
        ------
        InputError
            For an image of another shape or type.
        """
        if image.shape != self.grid.image_shape or image.dtype not in (np.uint8, np.uint16):
            raise InputError(
                f"image: {image.shape} {image.dtype}: {self.grid.image_shape} of uint8 or uint16"
            )
        out = out or self._out
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
            if target_rad is not None:
                take_out(out.d, target_rad, period)
            flag_light_edges(out.mean, out.modulation, out.d, out.flags, self._black, period)
            self._unwrapper.unwrap(out, guess, continued)
        return out

    def _level(self, image: Image, light_share: Single) -> Single:
        """The image at the light of rest, in the sensor's buffer."""
        if self._levelled is None:
            self._levelled = np.empty(self.grid.image_shape, np.float32)
        level(image, light_share, self._black, self._ceiling, self._levelled)
        return self._levelled
