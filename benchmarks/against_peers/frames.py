"""Planted frames: what a camera sees of carriers displaced by a known field, with noise and 8 bits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float

Frames = NDArray[np.uint8]

PERIOD_PX = 16
CONTRAST = 0.9
BLACK_GREY, FULL_GREY = 4.0, 204.0
SIGMA_GREY = 2.0
"""Standard deviation of a pixel's Gaussian noise, before rounding adds 1/12."""


@dataclass(frozen=True)
class Shot:
    """One picture: 0.5 (1 + across cos(2 pi u/P + shift) + down cos(2 pi v/P + shift))."""

    across: float
    down: float
    shift_rad: float = 0.0


@dataclass(frozen=True)
class Pattern:
    """The pictures that one reading takes."""

    shots: tuple[Shot, ...]

    def frames(
        self, displacement_px: Float, sigma_grey: float = 0.0, rng: np.random.Generator | None = None
    ) -> Frames:
        """(shots, rows, cols) uint8 of target((u, v) + d), d (rows, cols, 2) px; noise where rng is given."""
        return noisy(self.light_grey(displacement_px), sigma_grey, rng)

    def light_grey(self, displacement_px: Float) -> NDArray[np.float32]:
        """(shots, rows, cols) float32 grey without noise or rounding."""
        rows, cols = displacement_px.shape[:2]
        turn = 2 * np.pi / PERIOD_PX
        across = turn * (np.arange(cols)[None, :] + displacement_px[..., 0])
        down = turn * (np.arange(rows)[:, None] + displacement_px[..., 1])
        grey = np.empty((len(self.shots), rows, cols), np.float32)
        for shot, out in zip(self.shots, grey, strict=True):
            light: Float = np.ones((rows, cols))
            for weight, phase in ((shot.across, across), (shot.down, down)):
                if weight:
                    light += weight * np.cos(phase + shot.shift_rad)
            out[:] = BLACK_GREY + 0.5 * FULL_GREY * light
        return grey

    def target(self, shape: tuple[int, int]) -> Frames:
        """(shots, rows, cols) uint8 of the undisplaced pattern, without noise, from one period of it."""
        return repeated(self.frames(np.zeros((PERIOD_PX, PERIOD_PX, 2))), shape)

    def information(self) -> tuple[float, float]:
        """Squared grey per px, summed over the shots: mean (dI/du)^2 and mean (dI/dv)^2."""
        scale = 0.5 * (0.5 * FULL_GREY * 2 * np.pi / PERIOD_PX) ** 2
        return (
            scale * sum(shot.across**2 for shot in self.shots),
            scale * sum(shot.down**2 for shot in self.shots),
        )


CROSSED = Pattern((Shot(CONTRAST / 2, CONTRAST / 2),))
"""Both carriers in one picture, which share its contrast."""


def stepped(steps: int) -> Pattern:
    """`steps` shifted pictures of the carrier along u at full contrast, then as many along v."""
    shifts = [2 * np.pi * n / steps for n in range(steps)]
    across = tuple(Shot(CONTRAST, 0.0, shift) for shift in shifts)
    return Pattern(across + tuple(Shot(0.0, CONTRAST, shift) for shift in shifts))


def noisy(grey: NDArray[np.float32], sigma_grey: float, rng: np.random.Generator | None = None) -> Frames:
    """8-bit frames of light in grey, Gaussian noise added where rng is given."""
    if rng is not None and sigma_grey:
        grey = grey + np.float32(sigma_grey) * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def repeated(frames: Frames, shape: tuple[int, int]) -> Frames:
    """Frames (shots, rows, cols) side by side and one below the other, until they fill `shape`."""
    times = [-(-size // own) for size, own in zip(shape, frames.shape[1:], strict=True)]
    return np.ascontiguousarray(np.tile(frames, (1, *times))[:, : shape[0], : shape[1]])


@dataclass(frozen=True)
class Bump:
    """Planted displacement: a Gaussian in the middle of a frame, `peak_px` along u and -0.7 of it along v."""

    shape: tuple[int, int]
    peak_px: float
    width_px: float

    def at(self, u_px: Float, v_px: Float) -> Float:
        """(..., 2) px at camera positions."""
        rows, cols = self.shape
        r2 = (u_px - (cols - 1) / 2) ** 2 + (v_px - (rows - 1) / 2) ** 2
        height = self.peak_px * np.exp(-r2 / (2 * self.width_px**2))
        return np.stack([height, -0.7 * height], axis=-1)

    def everywhere(self) -> Float:
        """(rows, cols, 2) px at every pixel."""
        v, u = np.mgrid[: self.shape[0], : self.shape[1]].astype(float)
        return self.at(u, v)
