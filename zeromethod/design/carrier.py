"""The carrier's best period: a reading's noise against the finest picture that the LCD can draw.

A node's displacement is as uncertain at every period, but for the carrier's modulation; nodes lie half a
period apart, so that depth, which sums slopes from node to node, is the noisier the longer the period. Lens
and pixels take modulation from a short one: noise goes with period / modulation, least at 2 pi times the
blur's sigma. What forbids a short period is the LCD: a dent squeezes the picture, until fewer LCD pixels are
left per period than show it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.design.lever import bending, camera_px_per_mrad, largest_curvature_per_mm
from zeromethod.design.noise_floor import (
    contrast,
    depth_sigma_nm,
    displacement_sigma_px,
    drawn_share,
    slope_sigma_urad,
)
from zeromethod.design.sampled_view import SampledView, median_over
from zeromethod.errors import InputError
from zeromethod.sensing.known_order import STEEPEST
from zeromethod.warp.jacobian import FEWEST_LCD_PX

PERIODS_PX = (8, 10, 12, 14, 16, 18, 20, 24, 28, 32, 40, 48, 56, 64)
"""Periods that are tried, camera px: of those that a rig file allows."""

WANTED_SHARE = 0.5
"""Of the bend at which the mirror folds, up to which the LCD should be able to draw."""

NOTABLE = 0.05
"""Change of noise, or of the bend that can be drawn, from which another period is worth a word."""

_FEW = 0.05
"""Of the view's nodes, whose bend may be less than the one stated."""


def carrier_figures(view: SampledView, depth_rms_nm: float | None = None) -> dict[str, Any]:
    """Noise and limits by the carrier's period, and the best one.

    depth_rms_nm: one frame's at the rig's own period, where it is known. Best is the period of least depth
    noise of those with which bends of `WANTED_SHARE` of the fold limit can be nulled, else the one with which
    the sharpest can.

    Returns
    -------
    dict
        "present_px", "advised_px", "because" ("noise" or "LCD", what sets it), "wanted_share",
        "blur_px" (the lens's, as the rig has it) and "curve": per period "period_px", "lcd_px" (LCD px per
        period at rest), "modulation" (one carrier's amplitude over the mean light), "displacement_px",
        "slope_urad" (along x, along y) and "depth_rms_nm" (one frame's), "drawn_share" (the sharpest bend
        that is nulled, of the one that folds, in all but 5 % of the view), "bend_radius_mm" (that bend in the
        middle of the view), "tilt_mrad" (change between two frames in which every node by itself keeps its
        order: a quarter period).
    """
    rig = view.rig
    present = rig.target.period_px
    longest = max(min(rig.camera.columns, rig.camera.rows) // 4, present)
    views = {}
    for period in sorted({*PERIODS_PX, present}):
        target = rig.target.model_copy(update={"period_px": period})
        try:
            views[period] = SampledView(rig.model_copy(update={"target": target}))
        except InputError:  # too long for a node that sees the LCD
            continue
        if period >= longest:
            break
    curve = [_at(view, one) for one in views.values()]
    known = {present: depth_rms_nm} if depth_rms_nm is not None else {}
    growth = _growth(views, known)
    for row, one in zip(curve, growth, strict=True):
        row["depth_rms_nm"] = float(one * row["period_px"] * math.hypot(*row["slope_urad"]))
    good = [row for row in curve if row["drawn_share"] >= WANTED_SHARE]
    best = min(good, key=_noise) if good else max(curve, key=lambda row: float(row["drawn_share"]))
    by_lcd = best is not min(curve, key=_noise)
    return {
        "present_px": present,
        "advised_px": best["period_px"],
        "because": "LCD" if by_lcd else "noise",
        "wanted_share": WANTED_SHARE,
        "blur_px": rig.camera.psf_px,
        "curve": curve,
    }


def carrier_words(found: dict[str, Any]) -> str:
    """What another period would bring, in words; empty where the present one is as good within 5 %."""
    rows = {row["period_px"]: row for row in found["curve"]}
    now, best = rows[found["present_px"]], rows[found["advised_px"]]
    noise = _noise(best) / _noise(now)
    share = best["drawn_share"], now["drawn_share"]
    words = f"a carrier of {best['period_px']} instead of {now['period_px']} camera px"
    noisy = (
        f"{abs(noise - 1):.0%} {'more' if noise > 1 else 'less'} noise of depth "
        f"({best['depth_rms_nm']:.3g} instead of {now['depth_rms_nm']:.3g} nm in one frame)"
    )
    drawn = f"bends up to {share[0]:.0%} of the fold limit (now {share[1]:.0%})"
    if now["drawn_share"] < found["wanted_share"] and share[0] > share[1] + NOTABLE:
        return f"{words} would null {drawn}, with {noisy}"
    if noise < 1 - NOTABLE:
        return f"{words} would give {noisy}, and null {drawn}"
    return ""


def bend_share(view: SampledView, period_px: float) -> Float:
    """Sharpest bend of the mirror that is nulled, over the one that folds, (rows, cols).

    A dent's ring, bent by a share t of what folds, leaves 1 - t of the picture's width on the LCD. The share
    is that at which either carrier is left with `FEWEST_LCD_PX` across its fringes, as `warp_flags` counts
    them, in the worse of the directions in which the node folds first and last; at most that at which
    neighbouring nodes lose their order, which no period changes. 0 where the carrier is too fine at rest.
    """
    known = _known(view)
    at_rest, lever, point = (
        matrices[known] for matrices in (view.lcd_per_camera, view.sensitivity, view.mirror_per_camera)
    )
    folds, along = np.linalg.eigh(bending(view)[known])
    fewest2 = FEWEST_LCD_PX**2
    whole = (period_px * np.linalg.det(at_rest)) ** 2
    least = np.full(len(whole), STEEPEST)
    for k in range(2):
        e = along[..., k]
        with np.errstate(divide="ignore", invalid="ignore"):
            # change of dq/du by the bend that folds in this direction: an outer product
            change = (lever @ e[..., None]) * (e[:, None, :] @ point) / folds[:, k, None, None]
            for column in range(2):
                here, more = at_rest[..., column], change[..., column]
                # (P det (1 - t))^2 = 16 |here + t more|^2
                a = whole - fewest2 * np.sum(more * more, axis=-1)
                b = -2 * whole - 2 * fewest2 * np.sum(here * more, axis=-1)
                c = whole - fewest2 * np.sum(here * here, axis=-1)
                first = 2 * c / (-b + np.sqrt(b * b - 4 * a * c))
                share = np.where(c > 0.0, first * folds[:, 1] / folds[:, k], 0.0)
                least = np.where(folds[:, k] > 0.0, np.minimum(least, share), least)
    result = np.full(view.on_lcd.shape, np.nan)
    result[known] = least
    return result


def _known(view: SampledView) -> Mask:
    """Nodes that see the LCD, as do their surroundings, (rows, cols)."""
    known: Mask = view.on_lcd & np.isfinite(bending(view)).all(axis=(-1, -2))
    return known


def _at(view: SampledView, changed: SampledView) -> dict[str, Any]:
    """Figures of one period. view: of the rig's own nodes."""
    period, mask = changed.rig.target.period_px, view.central.mask
    image, jacobian = contrast(changed.rig), view.lcd_per_camera[_known(view)]
    across = np.abs(np.linalg.det(jacobian)) / np.linalg.norm(jacobian, axis=-2).max(axis=-1)
    shares = bend_share(view, period)
    drawn = float(np.nanquantile(shares, _FEW)) if np.isfinite(shares).any() else 0.0
    bend = drawn * float(np.nanmedian(largest_curvature_per_mm(view)[mask]))
    tilt = median_over(camera_px_per_mrad(view), mask)
    return {
        "period_px": period,
        "lcd_px": period * float(np.median(across)),
        "modulation": image.carrier / image.mean * float(np.nanmedian(drawn_share(changed)[changed.on_lcd])),
        "displacement_px": float(np.median(displacement_sigma_px(changed)[changed.on_lcd])),
        "slope_urad": median_over(slope_sigma_urad(changed), changed.on_lcd),
        "drawn_share": drawn,
        "bend_radius_mm": 1.0 / bend if bend > 0.0 else float("inf"),
        "tilt_mrad": period / 4 / max(tilt),
    }


def _noise(row: dict[str, Any]) -> float:
    """What periods are compared by: depth's noise, or where no depth is read that of slope x period."""
    depth = float(row["depth_rms_nm"])
    return depth if np.isfinite(depth) else float(row["period_px"] * math.hypot(*row["slope_urad"]))


def _growth(views: dict[int, SampledView], known: dict[int, float]) -> Float:
    """Depth's noise over slope's x period, at each period, (n,), nm per (urad px); NaN where none is read.

    Summing slopes over more nodes adds noise like the logarithm of their number, on the anchor's own terms:
    as the surface reader states it of the shortest, the present and the longest period. Between them the
    square goes smoothly with the logarithm of the period.
    """
    periods = np.array(list(views))
    read = known | {
        period: _depth_rms_nm(views[period]) for period in {int(periods[0]), int(periods[-1])} - set(known)
    }
    found: list[tuple[float, float]] = []
    for period, depth in read.items():
        slope = math.hypot(*median_over(slope_sigma_urad(views[period]), views[period].on_lcd))
        if np.isfinite(depth):
            found.append((math.log(period), (depth / (period * slope)) ** 2))
    if not found:
        return np.full(len(periods), np.nan)
    at, squares = np.array(sorted(found)).T
    fitted = np.polynomial.Polynomial.fit(at, squares, len(at) - 1)
    growth: Float = np.sqrt(np.maximum(fitted(np.log(periods)), 0.0))
    return growth


def _depth_rms_nm(view: SampledView) -> float:
    depth = depth_sigma_nm(view)[view.on_lcd]
    return float(np.sqrt(np.nanmean(depth**2))) if np.isfinite(depth).any() else float("nan")
