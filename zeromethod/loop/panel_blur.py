"""What the LCD's own blur does to the null: the lit apertures, and whatever else smears light at the panel.

Light that a camera pixel gets from LCD positions Q + e, <e> = 0, <e e> = s^2, carries the mean phase of the
picture there. Where the drawn warp is bent that is not the phase at Q: with C = s^2 J^-1 J^-T, J = dq/du, and
p the second derivatives of the inverse map in camera px, the pixel's phase along u is displaced by

    C : p / 2 - k^2 (C p C)_uu / 2 - k^2 l^2 (C p)_uu,

the last two because what is more blurred has less contrast, l^2 the lens's and pixel's variance. A null would
state the warp of a dent too large (by 2e-4 for s = 1 LCD px and a dent of sigma 4 mm on the packaged bench,
by 1e-3 at 1.5 mm). The lens's blur alone acts on the image, where the null is the target itself, and has no
effect.

s^2 is measured by the same fact that distinguishes both: a carrier of phase gradient k on the LCD loses
exp(-s^2 k^2 / 2) of its contrast at the panel, and a press changes k from node to node, where a lens's loss
stays as it is. Second differences over `REACH` nodes leave out what varies slowly: vignetting, glare, the
light's change with slope.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from zeromethod.arrays import Float, Mask, Single
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.lines import split

REACH = 6
"""Nodes over which second differences are taken: the windows do not overlap, and dents are as wide."""
PRIOR_PX2 = 0.3
"""Standard deviation of s^2 beyond the apertures' before anything was seen, LCD px^2."""
KEPT = 0.95
"""What is known counts that much less with every frame that says something new."""
LEARN_BELOW_PX = 0.1
"""Residual rms, camera px, above which contrast is also lost by displacement within the window."""
_CORRELATED = 4.0
"""Nodes among which noise counts once; every second one on each axis is used."""
_FLOOR = 0.005
"""Scatter of contrast from node to node without noise, relative: the panel's grid."""
_CLEAR_LCD_PX = 6.5
"""LCD px per period below which the drawn carrier is faded."""


class PanelBlur:
    """Estimate of s^2, LCD px^2, from frame to frame; starts from the apertures of the rig's panel."""

    def __init__(self, rig: Rig, grid: NodeGrid) -> None:
        across, along = rig.display.fill_factor
        self._start = self.variance_px2 = (across**2 + along**2) / 24
        self._grid, self._black = grid, rig.camera.noise.black_grey
        self._diagonal = rig.target.kind == "checker"
        self._wavenumber = 0.0 if rig.target.kind == "noise" else 2 * math.pi / grid.period_px
        self._image_px2 = rig.camera.psf_px**2 + 1 / 12
        self._sums = np.zeros(2)
        self._work = np.full((4, *grid.shape), np.nan)

    def learn(self, shown: Float, rest: Float, residual: Residual, valid: Mask, rms_px: float) -> None:
        """Take in what one frame says. shown, rest: (rows, cols, 2) LCD px; rms_px: of its residual."""
        if not (self._wavenumber and rms_px < LEARN_BELOW_PX):
            return
        product, square, noise = _contrast_changes(
            shown, rest, residual.modulation, residual.mean, residual.sigma, valid, self._diagonal,
            self._black, self._wavenumber, 1 / self._grid.spacing_px, self._work,
        )  # fmt: skip
        # a frame at rest says nothing and costs no memory
        if square * PRIOR_PX2**2 > noise:
            self._sums = KEPT * self._sums + (product, square)
        weight = noise / PRIOR_PX2**2
        product, square = self._sums
        if square > 0.0:
            self.variance_px2 = max(self._start + (product - self._start * square) / (square + weight), 0.0)

    def add_hidden(self, shown: Float, q: Float) -> None:
        """Add to a measured warp, in place, what the panel's blur has hidden from the null.

        shown, q: (rows, cols, 2) LCD px. The grid's outermost nodes are left out.
        """
        k2 = self._wavenumber**2
        _add_hidden(shown, self.variance_px2, k2 * self._grid.spacing_px**2, k2 * self._image_px2, q)


@numba.njit(cache=True)
def _contrast_changes(
    shown: Float,
    rest: Float,
    modulation: Single,
    mean: Single,
    sigma: Float,
    valid: Mask,
    diagonal: bool,
    black: float,
    wavenumber: float,
    inverse_spacing: float,
    work: Float,
) -> tuple[float, float, float]:
    """(sum x y, sum x^2, variance of y) of the second differences y of log contrast and x of -k^2 / 2."""
    rows, cols = valid.shape
    half = 0.5 * inverse_spacing
    steepest = (2 * math.pi / wavenumber / _CLEAR_LCD_PX) ** 2
    noise = 0.0
    count = 0
    for j in range(1, rows - 1, 2):
        for i in range(1, cols - 1, 2):
            for c in range(4):
                work[c, j, i] = math.nan
            light = mean[j, i] - black
            if not (valid[j, i] and light > 0.0):
                continue
            a, b = _gradients(shown, j, i, half, diagonal)
            if max(a, b) > steepest:
                continue
            a0, b0 = _gradients(rest, j, i, half, diagonal)
            work[0, j, i] = math.log(max(modulation[j, i, 0], 1e-9) / light)
            work[1, j, i] = math.log(max(modulation[j, i, 1], 1e-9) / light)
            work[2, j, i] = -0.5 * wavenumber * wavenumber * (a - a0)
            work[3, j, i] = -0.5 * wavenumber * wavenumber * (b - b0)
            noise += sigma[j, i, 0] ** 2 + sigma[j, i, 1] ** 2
            count += 2
    product = square = 0.0
    for j in range(1, rows - 1, 2):
        for i in range(1, cols - 1, 2):
            for axis in range(2):
                dj, di = (REACH, 0) if axis else (0, REACH)
                if j < dj or i < di or j + dj >= rows or i + di >= cols:
                    continue
                for c in range(2):
                    y = work[c, j + dj, i + di] + work[c, j - dj, i - di] - 2 * work[c, j, i]
                    x = work[2 + c, j + dj, i + di] + work[2 + c, j - dj, i - di] - 2 * work[2 + c, j, i]
                    if math.isfinite(x) and math.isfinite(y):
                        product += x * y
                        square += x * x
    scatter2 = _FLOOR * _FLOOR + wavenumber * wavenumber * noise / max(count, 1)
    return product, square, 6 * _CORRELATED * scatter2


@numba.njit(cache=True, inline="always")
def _gradients(q: Float, j: int, i: int, half: float, diagonal: bool) -> tuple[float, float]:
    """Squared gradients on the LCD of the two carriers' camera coordinates, (camera px / LCD px)^2."""
    xu, yu = half * (q[j, i + 1, 0] - q[j, i - 1, 0]), half * (q[j, i + 1, 1] - q[j, i - 1, 1])
    xv, yv = half * (q[j + 1, i, 0] - q[j - 1, i, 0]), half * (q[j + 1, i, 1] - q[j - 1, i, 1])
    area = xu * yv - xv * yu
    inverse = 1 / (area * area) if area != 0.0 else math.nan
    uu, vv, uv = inverse * (yv * yv + xv * xv), inverse * (yu * yu + xu * xu), -inverse * (yv * yu + xv * xu)
    if diagonal:
        return uu + 2 * uv + vv, uu - 2 * uv + vv
    return uu, vv


_FAST = {"contract", "reassoc", "arcp"}


@numba.njit(cache=True, fastmath=_FAST)
def _hidden(x: Float, y: Float, variance: float, k2: float, lens: float, out: Float) -> None:
    """What is hidden of a row of nodes, its two components apart (2, cols).

    x, y: (3, cols) both components of the row before, the row itself and the one after, so that the compiler
    vectorises it; all else as in `_add_hidden`.
    """
    xa, xh, xb, ya, yh, yb, along_x, along_y = x[0], x[1], x[2], y[0], y[1], y[2], out[0], out[1]
    for i in range(1, xh.size - 1):
        xu, yu = 0.5 * (xh[i + 1] - xh[i - 1]), 0.5 * (yh[i + 1] - yh[i - 1])
        xv, yv = 0.5 * (xb[i] - xa[i]), 0.5 * (yb[i] - ya[i])
        area = xu * yv - xv * yu
        inverse = area / max(area * area, 1e-9)
        scale = variance * inverse * inverse
        # C = s^2 J^-1 J^-T, and q'' halved, both in nodes
        uu, vv, uv = scale * (yv * yv + xv * xv), scale * (yu * yu + xu * xu), -scale * (yv * yu + xv * xu)
        xuu, yuu = 0.5 * (xh[i + 1] + xh[i - 1]) - xh[i], 0.5 * (yh[i + 1] + yh[i - 1]) - yh[i]
        xvv, yvv = 0.5 * (xb[i] + xa[i]) - xh[i], 0.5 * (yb[i] + ya[i]) - yh[i]
        xuv = 0.25 * (xb[i + 1] - xb[i - 1] - xa[i + 1] + xa[i - 1])
        yuv = 0.25 * (yb[i + 1] - yb[i - 1] - ya[i + 1] + ya[i - 1])
        ku, kv = 1 - lens - k2 * uu, 1 - lens - k2 * vv
        a, b, c = uu * (ku - lens), uv * ku, vv - k2 * uv * uv
        p, q = a * xuu + b * xuv + c * xvv, a * yuu + b * yuv + c * yvv
        along_u = inverse * (yv * p - xv * q)
        a, b, c = uu - k2 * uv * uv, uv * kv, vv * (kv - lens)
        p, q = a * xuu + b * xuv + c * xvv, a * yuu + b * yuv + c * yvv
        along_v = inverse * (xu * q - yu * p)
        along_x[i], along_y[i] = xu * along_u + xv * along_v, yu * along_u + yv * along_v


@numba.njit(cache=True, fastmath=_FAST)
def _add_hidden(shown: Float, variance: float, k2: float, lens: float, q: Float) -> None:
    """k2: of the carriers, rad^2 per node^2; 0 for a target without. lens: k^2 l^2."""
    rows, cols = shown.shape[0], shown.shape[1]
    x, y, hidden = np.empty((3, cols)), np.empty((3, cols)), np.empty((2, cols))
    for j in range(1, rows - 1):
        for k in range(3):
            split(shown[j - 1 + k], x[k], y[k])
        _hidden(x, y, variance, k2, lens, hidden)
        row = q[j]
        for i in range(1, cols - 1):
            row[i, 0] += hidden[0, i]
            row[i, 1] += hidden[1, i]
