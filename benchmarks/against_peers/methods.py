"""The contenders: frames in, displacement on a lattice of their own out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.against_peers.frames import (
    BLACK_GREY,
    CROSSED,
    PERIOD_PX,
    SIGMA_GREY,
    Frames,
    Pattern,
    stepped,
)
from benchmarks.peers import fourier_demodulation as fcd
from benchmarks.peers import phase_shifting as phases
from zeromethod.rig.model import Noise
from zeromethod.sensing import ResidualSensor
from zeromethod.warp.grid import NodeGrid

Displacement = NDArray[np.floating]

_opencv: Any = cv2  # whose type stubs know neither DIS nor a flow that is None

RESIDUAL = "residual (this system)"
DIS_FAST = "DIS fast"


@dataclass(frozen=True)
class Contender:
    """A way to measure displacement, ready for frames of one shape.

    read: (shots, rows, cols) uint8 of `pattern` -> d (lattice rows, lattice cols, 2) px, in the sense
    image(u, v) = target((u, v) + d); NaN where the method itself calls a point invalid.
    first_px, spacing_px: the lattice, alike on both axes. band: cycles per px up to which it may follow a
    displacement on either axis: half its lattice's rate; with one picture not beyond twice the carrier's
    frequency, as its carrier samples the displacement only twice a period. from_target: d is read at points
    of the target, which the image shows at (u, v) - d.
    """

    name: str
    pattern: Pattern
    first_px: int
    spacing_px: int
    band: float
    read: Callable[[Frames], Displacement]
    from_target: bool = False

    def places(self, read: Displacement) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(u, v), each (lattice rows, lattice cols): camera px that the displacements read belong to."""
        rows, cols = (self.first_px + self.spacing_px * np.arange(n, dtype=float) for n in read.shape[:2])
        u, v = np.meshgrid(cols, rows)
        return (u - read[..., 0], v - read[..., 1]) if self.from_target else (u, v)


def residual(shape: tuple[int, int]) -> Contender:
    """Residual of this system: one pass over the image, nodes every half period."""
    grid = NodeGrid(shape, PERIOD_PX)
    sensor = ResidualSensor(grid, "cosines", Noise(read_grey=SIGMA_GREY, black_grey=BLACK_GREY), 8)

    def read(frames: Frames) -> Displacement:
        found = sensor.measure(frames[0])
        d, flags = found.d[grid.inner], found.flags[grid.inner]
        return np.where((flags == 0)[..., None], d, np.nan) if flags.any() else d

    return Contender(RESIDUAL, CROSSED, PERIOD_PX, grid.spacing_px, 0.5 / grid.spacing_px, read)


def optical_flow(
    name: str, flow: Callable[[Frames, Frames], Displacement], shape: tuple[int, int]
) -> Contender:
    """A dense flow from the target, without noise, to the image: its motion is -d.

    The other way round DIS locks on to neighbouring periods, noise being in the picture that it tracks.
    """
    target = CROSSED.target(shape)[0]
    return Contender(name, CROSSED, 0, 1, 2 / PERIOD_PX, lambda frames: -flow(target, frames[0]), True)


def dis_solver(preset: str) -> Callable[[Frames, Frames], Displacement]:
    """OpenCV's dense inverse search: two pictures -> flow (rows, cols, 2). preset: "FAST" or "MEDIUM"."""
    solver = _opencv.DISOpticalFlow_create(getattr(cv2, f"DISOPTICAL_FLOW_PRESET_{preset}"))
    return lambda first, second: solver.calc(first, second, None)


def dis_fast(shape: tuple[int, int]) -> Contender:
    """OpenCV's dense inverse search, preset fast."""
    return optical_flow(DIS_FAST, dis_solver("FAST"), shape)


def dis_medium(shape: tuple[int, int]) -> Contender:
    """OpenCV's dense inverse search, preset medium."""
    return optical_flow("DIS medium", dis_solver("MEDIUM"), shape)


def farneback(shape: tuple[int, int]) -> Contender:
    """OpenCV's Farneback flow with the settings of its own manual; its window is about a period wide."""

    def flow(target: Frames, image: Frames) -> Displacement:
        found: Displacement = _opencv.calcOpticalFlowFarneback(target, image, None, 0.5, 3, 15, 3, 5, 1.2, 0)
        return found

    return optical_flow("Farneback", flow, shape)


def fourier_demodulation(shape: tuple[int, int]) -> Contender:
    """FCD, dense, in complex64."""
    carriers = fcd.carriers_of(CROSSED.target(shape)[0], PERIOD_PX)
    return Contender(
        "Fourier demodulation",
        CROSSED,
        0,
        1,
        2 / PERIOD_PX,
        lambda frames: fcd.displacement(frames[0], carriers),
    )


def phase_shifting(steps: int) -> Callable[[tuple[int, int]], Contender]:
    """N-step phase shifting, dense; its time is that of all 2 N frames' arithmetic, not of taking them."""

    def contender(shape: tuple[int, int]) -> Contender:  # noqa: ARG001 - needs no buffers
        name = f"phase shifting, {steps} steps"
        pattern = stepped(steps)
        return Contender(name, pattern, 0, 1, 0.5, lambda frames: phases.displacement(frames, PERIOD_PX))

    return contender


CONTENDERS: dict[str, Callable[[tuple[int, int]], Contender]] = {
    RESIDUAL: residual,
    DIS_FAST: dis_fast,
    "DIS medium": dis_medium,
    "Farneback": farneback,
    "Fourier demodulation": fourier_demodulation,
    "phase shifting, 4 steps": phase_shifting(4),
    "phase shifting, 8 steps": phase_shifting(8),
}
"""Makers by name: frame shape (rows, cols) -> contender."""
