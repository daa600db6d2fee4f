"""Expected light of each camera pixel over that at rest, where the mirror reflects only partially.

Beyond the critical angle the mirror reflects all light at any slope, and less light means contact. Below it
Fresnel's reflectance follows the slope: at 45 degrees and n = 1.41 a press of 24 mrad changes it from 0.40 to
1, and within 3 mrad of rest it rises by 0.27 with a kink, a step for the carrier's window. None of this is
contact, and all of it is known from the warp: the image is divided by it before light is judged.
"""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Float, Ints, Single
from zeromethod.kernels import kernel, read
from zeromethod.optics import Optics
from zeromethod.optics.fresnel import fresnel
from zeromethod.optics.mirror import normal_of
from zeromethod.surface.integrate import SlopeIntegrator
from zeromethod.surface.rays import MirrorRays
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.interpolant import keys
from zeromethod.warp.rest import Rest

PASSES = 4
SETTLED_MM = 2e-3
"""Most passes of slope and depth, and the change of depth that ends them: a slope of 0.05 mrad, a tenth of a
pixel's. They start from the last depth, so that one usually suffices."""

LEAST_SHARE = 0.2
"""Least share that is used, so that a wrong warp cannot amplify noise without bounds."""


def _taps(nodes: Float, spacing_px: int, pixels: int) -> tuple[Ints, Single]:
    """First node (pixels,) and weights (pixels, 4) of Keys' interpolant, as used to draw warps."""
    place = (np.arange(pixels) - nodes[0]) / spacing_px
    first = np.clip(place.astype(np.int64), 1, nodes.size - 3)
    weights = np.stack(keys(place - first), axis=-1).astype(np.float32)
    return first - 1, weights


@kernel(
    read(numba.float32, 2), read(numba.int64, 1), read(numba.float32, 2), read(numba.int64, 1),
    read(numba.float32, 2), read(numba.float32, 2), read(numba.float32, 2), read(numba.float32, 2),
    numba.float32, numba.float32, numba.float32[::1], numba.float32[:, ::1], fastmath=True,
)  # fmt: skip
def _share(
    change: Single,
    rows: Ints,
    down: Single,
    cols: Ints,
    across: Single,
    rest_cosine: Single,
    s_share: Single,
    rest: Single,
    n: float,
    floor: float,
    line: Single,
    out: Single,
) -> None:
    """Reflectance over that at rest, with the change of the cosine of incidence interpolated from nodes.

    n: index of the prism; floor: least share; line: (node columns,) to work with.
    """
    one = np.float32(1)
    for row in range(out.shape[0]):
        j, w = rows[row], down[row]
        for i in range(line.size):
            line[i] = (
                w[0] * change[j, i]
                + w[1] * change[j + 1, i]
                + w[2] * change[j + 2, i]
                + w[3] * change[j + 3, i]
            )
        for col in range(out.shape[1]):
            i, w = cols[col], across[col]
            c = rest_cosine[row, col]
            c += w[0] * line[i] + w[1] * line[i + 1] + w[2] * line[i + 2] + w[3] * line[i + 3]
            t = np.sqrt(max(one - n * n * (one - c * c), np.float32(0)))
            s, p = (n * c - t) / (n * c + t), (c - n * t) / (c + n * t)
            share = s_share[row, col]
            out[row, col] = max((share * s * s + (one - share) * p * p) / rest[row, col], floor)


def _is_partial(optics: Optics, grid: NodeGrid) -> bool:
    """Whether some of the light passes the mirror at rest, by every fourth pixel and the image's border.

    The angle of incidence has no extremum between pixels so close to each other.
    """
    rows, cols = grid.image_shape
    v, u = (np.unique(np.append(np.arange(0, n, 4), n - 1)).astype(np.float64) for n in (rows, cols))
    columns, lines = np.meshgrid(u, v)
    reflectance = optics.trace(columns, lines, optics.rest).reflectance
    return bool((reflectance[reflectance > 0] < 1 - 1e-9).any())


class ExpectedLight:
    """Reflectance of the mirror over that at rest, per camera pixel, predicted from a warp."""

    def __init__(self, optics: Optics, rest: Rest) -> None:
        """Prepare for the rig of `optics`; `needed`: whether the light depends on the slope at all."""
        grid = rest.grid
        index = optics.rig.prism.index
        self.needed = _is_partial(optics, grid)
        if not self.needed:
            return
        v, u = np.indices(grid.image_shape, dtype=np.float64)
        trace = optics.trace(u, v, optics.rest)
        known = np.isfinite(trace.reflectance) & (trace.reflectance > 0)
        # the angle is arbitrary for pixels that miss the mirror: their light is not expected to change
        cosine = np.where(known, trace.cos_incidence, 1.0)
        s, p = fresnel(cosine, index, 1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            s_share = np.where(known & (s > p), (trace.reflectance - p) / (s - p), 0.5)
        # the slope hardly turns the plane of incidence, so that the share of s light stays that of rest
        self._rest_light = [a.astype(np.float32) for a in (cosine, s_share, s_share * s + (1 - s_share) * p)]
        self._index = index
        self._prepare_nodes(optics, grid)

    def _prepare_nodes(self, optics: Optics, grid: NodeGrid) -> None:
        nodes = grid.mesh()
        self._rays = MirrorRays(optics, *nodes)
        _, self._direction = optics.rubber_rays(*nodes)
        rest_slope, rest_point = self._rays.slope(np.zeros(grid.shape), self._rays.rest_q)
        self._rest = optics.rest
        self._rest_cosine = self._cosine(rest_slope, rest_point)
        x, y = np.nan_to_num(rest_point[..., 0]), np.nan_to_num(rest_point[..., 1])
        self._integrator = SlopeIntegrator(x, y)
        usable = self._rays.hits & np.isfinite(self._rest_cosine)
        self._integrator.prepare(usable, np.ones((*grid.shape, 2)))
        rim = np.zeros(grid.shape, np.bool_)
        rim[grid.inner] = True
        rim[tuple(slice(s.start + 1, s.stop - 1) for s in grid.inner)] = False
        island = self._integrator.island
        self._rim = rim & island if (rim & island).any() else island
        self._depth = np.zeros(grid.shape)
        rows, cols = grid.image_shape
        self._taps = (*_taps(grid.v_px, grid.spacing_px, rows), *_taps(grid.u_px, grid.spacing_px, cols))
        self._out = np.ones((rows, cols), np.float32)

    def _cosine(self, slope: Float, point: Float) -> Float:
        """Cosine of the angle of incidence per node."""
        gx, gy = self._rest.gradient(point[..., 0], point[..., 1])
        normal = normal_of((gx - slope[..., 0], gy - slope[..., 1]))
        return np.asarray((self._direction * normal).sum(axis=-1))

    def share(self, q: Float) -> Single:
        """(rows, cols) of the image: light expected over that at rest, where the nodes look at `q` (LCD px).

        Depth matters because the same LCD position means another slope at another depth (5 mrad at 0.2 mm
        here); it is assumed to be 0 at the rim of the view. The lens is ignored: blurring the share by its
        0.7 px does not improve the reading. The array is overwritten by the next call.
        """
        island = self._integrator.island
        for _ in range(PASSES):
            slope, point = self._rays.slope(self._depth, q)
            slope = np.where(island[..., None] & np.isfinite(slope), slope, 0.0)
            x, y = np.nan_to_num(point[..., 0]), np.nan_to_num(point[..., 1])
            depth = self._depth + self._integrator.integrate(slope, x, y, self._depth)
            depth -= np.median(depth[self._rim])
            depth[~island] = 0.0
            moved = float(np.max(np.abs(depth - self._depth)))
            self._depth = depth
            if moved < SETTLED_MM:
                break
        change = np.nan_to_num(self._cosine(slope, point) - self._rest_cosine).astype(np.float32)
        rows, down, cols, across = self._taps
        cosine, s_share, light = self._rest_light
        line = np.empty(change.shape[1], np.float32)
        numbers = self._index, LEAST_SHARE
        _share(change, rows, down, cols, across, cosine, s_share, light, *numbers, line, self._out)
        return self._out
