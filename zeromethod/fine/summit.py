"""Summit of a depth on pixels: the extreme of a quartic through as much of a dent's top as it describes.

Noise of depth varies slowly over the view, so that a fit of few pixels hardly averages it. The top is the
connected part around the deepest pixel that is at least 0.7 as deep: of a Gaussian dent 0.85 sigma, where a
quartic is off by 0.03 %. Less of it is taken where a quartic misses it by more than noise: flat punches.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Float, Mask, Single

_SMOOTH_PX = 5
"""Side of the square whose mean depth says where the deepest pixel is."""
_LEAST_PX = 4
"""Half width of the least square of pixels: a fifth of a millimetre on the packaged bench."""
_TOPS = 0.7, 0.85, 0.93
"""Share of the largest depth that a pixel of the top has, until a quartic describes it."""
_NOISES, _SHARE = 4.0, 5e-5
"""Most that a quartic may miss a top by, rms: so many times what it misses the least square by (noise alone,
which has every wavelength, makes 2.6 to 3.4 over a top of 8,000 pixels), or a share of the depth."""
_MOST_PIXELS = 20_000
"""Pixels of a top that are fitted, evenly chosen."""
_PLACES = 41
"""Places along each side at which the quartic is looked at."""


def summit(depth_mm: Single, x_mm: Single, y_mm: Single, valid: Mask) -> tuple[float, float, float]:
    """(depth, x, y) in mm of the deepest place, bulges included; NaN where nothing is known.

    All (rows, cols). The deepest pixel is that of the mean over 5 x 5.
    """
    size = _SMOOTH_PX, _SMOOTH_PX
    depth = np.where(valid, depth_mm, np.float32(0.0))
    smooth = np.asarray(cv2.boxFilter(depth, -1, size, borderType=cv2.BORDER_CONSTANT))
    whole = cv2.erode(valid.view(np.uint8), np.ones(size, np.uint8), borderValue=0).view(np.bool_)
    if not whole.any():
        return float("nan"), float("nan"), float("nan")
    row, col = np.unravel_index(int(np.argmax(np.where(whole, np.abs(smooth), -1.0))), whole.shape)
    near = np.zeros_like(valid)
    near[max(row - _LEAST_PX, 0) : row + _LEAST_PX + 1, max(col - _LEAST_PX, 0) : col + _LEAST_PX + 1] = True
    at = float(x_mm[row, col]), float(y_mm[row, col])

    def fit(among: Mask) -> _Quartic | None:
        rows, cols = np.nonzero(among & valid)
        some = slice(None, None, 1 + len(rows) // _MOST_PIXELS)
        depth, x, y = (one[rows[some], cols[some]] for one in (depth_mm, x_mm, y_mm))
        return _quartic(depth, x, y, at)

    least = fit(near)
    if least is None:
        return float(depth_mm[row, col]), *at
    most_mm = max(_NOISES * least[1], _SHARE * abs(float(smooth[row, col])))
    for share in _TOPS:
        high = (smooth * np.sign(smooth[row, col]) > share * abs(smooth[row, col])) & whole
        _, labels = cv2.connectedComponents(high.view(np.uint8), connectivity=4)
        found = fit(near | (labels == labels[row, col]))
        if found is not None and found[1] <= most_mm:
            return found[0]
    return least[0]


_Quartic = tuple[tuple[float, float, float], float]


def _quartic(depth: Single, x: Single, y: Single, at: tuple[float, float]) -> _Quartic | None:
    """Largest depth of the quartic through points and its place near `at`, and what it misses, rms; in mm.

    None where there are too few points.
    """
    half = max(float(np.ptp(x)) / 2, 1e-9), max(float(np.ptp(y)) / 2, 1e-9)
    terms = _powers(*((one.astype(np.float64) - a) / h for one, a, h in zip((x, y), at, half, strict=True)))
    if len(terms) < 2 * terms.shape[1]:
        return None
    known = depth.astype(np.float64)
    fitted = np.linalg.lstsq(terms, known, rcond=None)[0]
    s, t = (one.ravel() for one in np.meshgrid(*(np.linspace(-0.5, 0.5, _PLACES),) * 2))
    values = _powers(s, t) @ fitted
    best = int(np.argmax(np.abs(values)))
    place = at[0] + half[0] * float(s[best]), at[1] + half[1] * float(t[best])
    missed = float(np.sqrt(np.mean((known - terms @ fitted) ** 2)))
    return (float(values[best]), *place), missed


def _powers(s: Float, t: Float) -> Float:
    """(n, 15) products of powers up to the fourth."""
    return np.stack([s**i * t**j for i in range(5) for j in range(5 - i)], axis=-1)
