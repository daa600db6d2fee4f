"""Fine reader: the last frames to slope and depth on every camera pixel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from zeromethod.arrays import Float, Image, Mask, Single
from zeromethod.fine.contradiction import Scatter, contradicted
from zeromethod.fine.demodulate import Demodulated, Design, demodulate, grey_variance, stood, usable_pixels
from zeromethod.fine.detail import pixel_detail
from zeromethod.fine.footprint import Footprint
from zeromethod.fine.frames import FineFrame, FrameSequence
from zeromethod.fine.integrate import PixelIntegrator, gradient, largest_part, sources, step_weights, take_out
from zeromethod.fine.lateness import lateness
from zeromethod.fine.lattice import PixelLattice, uncovered_box
from zeromethod.fine.nodes import NodeWindows, read_nodes
from zeromethod.fine.noise import DetailNoise
from zeromethod.fine.slope import Planes, lever_planes, pixel_slopes
from zeromethod.fine.surface import FineSurface
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Limits
from zeromethod.surface import Surface, SurfaceReader
from zeromethod.surface.differences import depth_differences
from zeromethod.warp.continuation import continue_smoothly
from zeromethod.warp.grid import NodeGrid

_MOST_SIGMA_PX = 2.0
"""Standard deviation of a pixel's displacement, an eighth of a period, above which it is left out."""

_UNSEEN = 100.0
"""Variance of pixels that are not seen over the usual one: they hardly count beside others. (With much more,
the solution takes hundreds of iterations.)"""
_LEAST_SHARE = 0.02
"""Share of the frames' fit below which pixels need not be seen by themselves."""


class FineReader:
    """Reader of fine surfaces from the last frames of a run under a target that steps.

    Keeps lattices and the last solution between readings; they affect speed alone.

    Parameters
    ----------
    rig : Rig
        Bench and target.
    optics : Optics
        Rays of the rig.
    grid : NodeGrid
        Nodes of the warps.
    divide : bool
        Divide depth by the pupil's footprint and the lens's blur, as far as the rig file states them;
        without, depth is the mirror's as seen through both.
    """

    def __init__(self, rig: Rig, optics: Optics, grid: NodeGrid, divide: bool = True) -> None:
        self._camera, self._grid = rig.camera, grid
        self._lattice = PixelLattice(grid)
        self._reader = SurfaceReader(rig, optics, grid)
        self._integrator = PixelIntegrator(self._lattice.shape)
        self._footprint = Footprint(rig, optics, self._lattice, divide)
        self._detail_noise = DetailNoise(grid.period_px, self._footprint.gains)
        self._last = np.zeros(self._lattice.shape, np.float32)

    def read(self, frames: Sequence[FineFrame]) -> FineSurface:
        """Slope and depth of every pixel.

        Parameters
        ----------
        frames : sequence of FineFrame
            At least five, oldest first; the mirror is read as it was in the newest.

        Returns
        -------
        FineSurface
            NaN where a pixel, or the nodes around it, were not seen well enough, or the frames contradict
            each other: something narrow came or went.

        Raises
        ------
        InputError
            Where the target's phases in these frames do not determine a pixel's displacement.
        MeasurementError
            Where the depth that explains the slopes was not found; the next reading does not start from it.
        """
        lattice, inner = self._lattice, self._grid.inner
        nodes, d, variance, seen, contradictory = self._fitted(frames)
        surface = self._reader.follow(nodes.warp)
        coarse_slope, coarse_depth = _continued(surface, inner)
        share = np.clip(lattice.to_pixels(nodes.share[inner]), np.float32(0.0), np.float32(1.0))
        away = continue_smoothly(
            nodes.window - nodes.offset, np.asarray(np.isfinite(nodes.window).all(axis=-1))
        )[inner]
        d = self._footprint.without_grid(d, seen)
        pixel_detail(lattice, nodes.shown, away, share, d, seen)
        variance[~seen] = np.float32(_UNSEEN * float(np.median(variance[::8, ::8])))
        # what moves may blur within the frames: there the nodes are read all the same
        valid = lattice.enclosed(surface.valid[inner]) & (seen | (share < _LEAST_SHARE)) & ~contradictory
        lever, by_slope, turned = lever_planes(self._reader.lever, coarse_depth, coarse_slope)
        jacobian = np.moveaxis(nodes.bending[inner].reshape(*lattice.nodes, 4), -1, 0)
        planes = Planes(turned, lever, by_slope, jacobian, np.moveaxis(coarse_slope, -1, 0))
        slope, slope2 = pixel_slopes(lattice, d, planes, variance)
        del d, variance, planes
        valid = largest_part(valid & np.isfinite(slope[0] + slope2[0] + slope2[1]))
        x, y = lattice.to_pixels(np.stack([surface.x_mm[inner], surface.y_mm[inner]]))
        depth = self._integrated(slope, slope2, x, y, coarse_depth, valid, surface.anchor.mask[inner])
        before, depth = depth, self._footprint.applied(depth)
        if depth is not before:
            slope += gradient(depth - before, x, y)
        del before
        variance_mm2 = self._depth_variance(surface, x, y, slope2, share, valid)
        slope2 *= share**2
        if (share < 1.0).any():
            slope2 += (1 - share) ** 2 * self._window_slope2(surface)
        valid &= np.isfinite(depth + variance_mm2)
        for one in (depth, variance_mm2, slope[0], slope[1], slope2[0], slope2[1]):
            one[~valid] = np.nan
        box = lattice.box
        return FineSurface(
            depth_mm=depth,
            slope=np.ascontiguousarray(np.moveaxis(slope, 0, -1)),
            x_mm=x,
            y_mm=y,
            sigma_depth_mm=np.sqrt(variance_mm2, out=variance_mm2),
            sigma_slope=np.ascontiguousarray(np.moveaxis(np.sqrt(slope2, out=slope2), 0, -1)),
            valid=valid,
            share=share,
            first_px=(box[0].start, box[1].start),
            time_ns=surface.time_ns,
            frames=len(frames),
            coarse=surface,
            footprint_divided=self._footprint.divides,
            spacing_px=self._grid.spacing_px,
        )

    def _fitted(self, frames: Sequence[FineFrame]) -> tuple[NodeWindows, Single, Single, Mask, Mask]:
        """Nodes, and of the pixels displacement and its variance (rows, cols, 2), and two masks (rows, cols).

        Which pixels are usable, and at which frames contradict each other.
        """
        images = [frame.image for frame in frames]
        sequence = FrameSequence.of(frames, self._grid)
        steps = sequence.steps
        # the codes of a strip change from picture to picture, which would pass for lateness
        box = uncovered_box(self._grid, frames[-1].measured.flags)
        late_s = lateness(images, steps, Design.of(steps), self._noise_grey(images), sequence.scan, box)
        design = Design.of(steps, late_s)
        pixels = self._demodulated(images, design)
        limits = Limits()
        ceiling = 2**self._camera.bits - 1
        usable = usable_pixels(pixels, ceiling, limits.visibility, _MOST_SIGMA_PX)
        d, variance, standing = pixels.d, pixels.variance, stood(pixels)
        scatter = Scatter.of(self._lattice, pixels, len(frames), self._camera.noise)
        del images, steps, pixels
        nodes = read_nodes(self._lattice, frames, sequence, design, late_s, d, variance, usable, standing)
        contradictory = contradicted(self._lattice, scatter, nodes.moved2[:, *self._grid.inner])
        return nodes, d, variance, usable, contradictory

    def _noise_grey(self, images: Sequence[Image]) -> float:
        typical = np.asarray(images[0][::8, ::8].mean(), np.float32)
        return float(np.sqrt(grey_variance(self._camera.noise, typical)))

    def _demodulated(self, images: Sequence[Image], design: Design) -> Demodulated:
        """Pixels between the nodes."""
        return demodulate(images, design, self._grid.period_px, self._camera.noise, self._lattice.box)

    def _integrated(
        self,
        slope: Single,
        slope2: Single,
        x: Single,
        y: Single,
        coarse_mm: Float,
        valid: Mask,
        anchored: Mask,
    ) -> Single:
        """Depth (rows, cols), mm: what the nodes' lacks, with the nodes' mean where those are anchored."""
        level_mm = self._lattice.to_pixels(coarse_mm)
        scale = self._lattice.to_pixels(self._reader.scale)
        slopes = np.where(valid, slope, np.float32(0.0))
        across, down = depth_differences(np.moveaxis(slopes, 0, -1), x, y, valid)
        del slopes
        down = np.ascontiguousarray(down)
        take_out(level_mm, scale, across, down)
        weights = step_weights(slope2, x, y, scale, valid)
        left = sources((across, down), weights)
        del across, down
        found = self._last.copy()
        self._integrator.solve(left, weights, found)
        self._last = found
        del left, weights
        error = self._last - _mean(self._last, self._lattice.enclosed(anchored) & valid, valid)
        error *= scale
        error += level_mm
        return error

    def _window_slope2(self, surface: Surface) -> Single:
        """Variance (2, rows, cols) of the nodes' slope between them."""
        sigma = surface.sigma_slope[self._grid.inner]
        whole = continue_smoothly(sigma, np.asarray(np.isfinite(sigma).all(axis=-1)))
        return self._lattice.to_pixels(np.moveaxis(whole, -1, 0)) ** 2

    def _depth_variance(
        self, surface: Surface, x: Single, y: Single, slope2: Single, share: Single, valid: Mask
    ) -> Single:
        """Variance (rows, cols) of depth: the nodes', and the pixels' own beyond the nodes' window."""
        inner = self._grid.inner
        sigma = surface.sigma_depth_mm[inner]
        both = continue_smoothly(np.stack([sigma, sigma], axis=-1), np.isfinite(sigma))[..., 0]
        nodes2 = self._lattice.to_pixels(both) ** 2
        if valid.any():
            own = self._detail_noise.variance(slope2, x, y, valid)
            own *= share**2
            nodes2 += own
        return nodes2


def _continued(surface: Surface, inner: tuple[slice, slice]) -> tuple[Float, Float]:
    """Slope (rows, cols, 2) and depth (rows, cols) of the inner nodes, continued where they were not read."""
    slope, depth = surface.slope[inner], surface.depth_mm[inner]
    known = np.isfinite(depth)
    pair = continue_smoothly(np.stack([depth, depth], axis=-1), known)
    return continue_smoothly(slope, known), pair[..., 0]


def _mean(values: Single, among: Mask, otherwise: Mask) -> np.float32:
    """Mean over some pixels; over others where there are none."""
    of = among if among.any() else otherwise
    return np.float32(values[of].mean(dtype=np.float64) if of.any() else 0.0)
