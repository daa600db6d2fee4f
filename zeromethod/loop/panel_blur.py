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
from typing import Any

import numba
import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.kernels import kernel, read
from zeromethod.rig.model import Rig
from zeromethod.sensing.residual import Residual
from zeromethod.warp.components import squared_length
from zeromethod.warp.grid import NodeGrid

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
_SOME = np.s_[1:-1:2, 1:-1:2]


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
        self._rest: Float | None = None
        self._squares_at_rest: tuple[Float, Float]

    def learn(self, shown: Float, rest: Float, residual: Residual, valid: Mask, rms_px: float) -> None:
        """Take in what one frame says. shown, rest: (rows, cols, 2) LCD px; rms_px: of its residual."""
        if not (self._wavenumber and rms_px < LEARN_BELOW_PX):
            return
        product, square, noise = self._contrast_changes(shown, rest, residual, valid)
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
        x, y = shown[..., 0], shown[..., 1]
        hidden = np.zeros((2, *x.shape))
        _hidden(x, y, self.variance_px2, k2 * self._grid.spacing_px**2, k2 * self._image_px2, *hidden)
        q[..., 0] += hidden[0]
        q[..., 1] += hidden[1]

    def _contrast_changes(
        self, shown: Float, rest: Float, residual: Residual, valid: Mask
    ) -> tuple[float, float, float]:
        """(sum x y, sum x^2, variance of y) of the second differences y of log contrast and x of -k^2 / 2.

        By every second node on each axis.
        """
        modulation, sigma = residual.modulation[_SOME].astype(float), residual.sigma[_SOME].copy()
        light = residual.mean[_SOME] - self._black
        if rest is not self._rest:
            self._rest, self._squares_at_rest = rest, self._squared_gradients(rest)
        squares, at_rest = self._squared_gradients(shown), self._squares_at_rest
        steepest = (2 * math.pi / self._wavenumber / _CLEAR_LCD_PX) ** 2
        good = valid[_SOME] & (light > 0.0) & ~(np.maximum(squares[0], squares[1]) > steepest)
        light = np.where(good, light, 1.0)
        known = good & np.isfinite(squares[0] - at_rest[0])
        product = square = 0.0
        for k in range(2):
            contrast = np.log(np.maximum(modulation[..., k], 1e-9) / light)
            expected = -0.5 * self._wavenumber**2 * (squares[k] - at_rest[k])
            for axis in range(2):
                before, middle, after = _apart(known, axis)
                all_known = before & middle & after
                y, x = (_bend(values, axis)[all_known] for values in (contrast, expected))
                product += float(x @ y)
                square += float(x @ x)
        noise = squared_length(sigma)[good].sum() / max(2 * np.count_nonzero(good), 1)
        scatter2 = _FLOOR**2 + self._wavenumber**2 * float(noise)
        return product, square, 6 * _CORRELATED * scatter2

    def _squared_gradients(self, q: Float) -> tuple[Float, Float]:
        """Of both carriers' camera coordinates on the LCD, (camera px / LCD px)^2, at every second node."""
        half = 0.5 / self._grid.spacing_px
        along = [half * (one[1:-1:2, 2::2] - one[1:-1:2, :-2:2]) for one in (q[..., 0], q[..., 1])]
        across = [half * (one[2::2, 1:-1:2] - one[:-2:2, 1:-1:2]) for one in (q[..., 0], q[..., 1])]
        (xu, yu), (xv, yv) = along, across
        area = xu * yv - xv * yu
        inverse = 1 / np.where(area == 0.0, np.nan, area) ** 2
        uu, vv, uv = (
            inverse * (yv * yv + xv * xv),
            inverse * (yu * yu + xu * xu),
            -inverse * (yv * yu + xv * xu),
        )
        return (uu + 2 * uv + vv, uu - 2 * uv + vv) if self._diagonal else (uu, vv)


def _apart(values: Any, axis: int) -> tuple[Any, Any, Any]:
    """Values of every second node along an axis, `REACH` nodes apart."""
    lines, by = np.swapaxes(values, 0, axis), REACH // 2
    return lines[: -2 * by], lines[by:-by], lines[2 * by :]


def _bend(values: Float, axis: int) -> Float:
    """Second differences over `REACH` nodes along an axis of every second of them."""
    before, middle, after = _apart(values, axis)
    return np.asarray(before + after - 2 * middle)


@kernel(
    read(numba.float64, 2), read(numba.float64, 2), numba.float64, numba.float64, numba.float64,
    numba.float64[:, ::1], numba.float64[:, ::1], fastmath={"contract", "reassoc", "arcp"},
)  # fmt: skip
def _hidden(
    x: Float, y: Float, variance: float, k2: float, lens: float, hidden_x: Float, hidden_y: Float
) -> None:
    """What the blur has hidden of x, y (rows, cols) as shown; 0 at the outermost nodes.

    k2: of the carriers, rad^2 per node^2; 0 for a target without. lens: k^2 l^2.
    """
    for j in range(1, x.shape[0] - 1):
        xa, xh, xb, ya, yh, yb = x[j - 1], x[j], x[j + 1], y[j - 1], y[j], y[j + 1]
        along_x, along_y = hidden_x[j], hidden_y[j]
        for i in range(1, x.shape[1] - 1):
            xu, yu = 0.5 * (xh[i + 1] - xh[i - 1]), 0.5 * (yh[i + 1] - yh[i - 1])
            xv, yv = 0.5 * (xb[i] - xa[i]), 0.5 * (yb[i] - ya[i])
            area = xu * yv - xv * yu
            inverse = area / max(area * area, 1e-9)
            scale = variance * inverse * inverse
            # C = s^2 J^-1 J^-T, and q'' halved, both in nodes
            uu, vv, uv = (
                scale * (yv * yv + xv * xv),
                scale * (yu * yu + xu * xu),
                -scale * (yv * yu + xv * xu),
            )
            xuu, yuu = 0.5 * (xh[i + 1] + xh[i - 1]) - xh[i], 0.5 * (yh[i + 1] + yh[i - 1]) - yh[i]
            xvv, yvv = 0.5 * (xb[i] + xa[i]) - xh[i], 0.5 * (yb[i] + ya[i]) - yh[i]
            xuv = 0.25 * (xb[i + 1] - xb[i - 1] - xa[i + 1] + xa[i - 1])
            yuv = 0.25 * (yb[i + 1] - yb[i - 1] - ya[i + 1] + ya[i - 1])
            ku, kv = 1 - lens - k2 * uu, 1 - lens - k2 * vv
            a, b, c = uu * (ku - lens), uv * ku, vv - k2 * uv * uv
            first, second = a * xuu + b * xuv + c * xvv, a * yuu + b * yuv + c * yvv
            along_u = inverse * (yv * first - xv * second)
            a, b, c = uu - k2 * uv * uv, uv * kv, vv * (kv - lens)
            first, second = a * xuu + b * xuv + c * xvv, a * yuu + b * yuv + c * yvv
            along_v = inverse * (xu * second - yu * first)
            along_x[i], along_y[i] = xu * along_u + xv * along_v, yu * along_u + yv * along_v
