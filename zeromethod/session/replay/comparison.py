"""How well sessions followed their mirror: residual, lag, rejection over frequency, depth error.

All figures come from what a loop knows, so that recorded and simulated sessions are judged alike: the mirror
is where each frame measured it, whatever was shown. Only depth is compared with the truth, which only
simulated sessions have.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.arrays import Float
from zeromethod.session.replay.track import Track

Figures = dict[str, Any]

MOVING = 5.0
"""Times the noise of a velocity from which a node counts as moving."""

LEAST_MOVING = 200
"""Components of nodes in frames that must move for there to be a lag."""

SEGMENT_FRAMES = 64
"""Length of the stretches whose spectra are averaged; shorter tracks are one stretch."""

LEAST_FRAMES = 24
"""Frames of a track below which it is not compared: too few for its curve."""

BANDS_HZ = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Borders of the bands in which rejection is given as a number."""

ABOVE_NOISE = 3.0
"""Times the noise's power from which motion at a frequency counts."""

DEEP_SHARE = 0.5
"""Share of the deepest true peak from which a peak's error counts."""

MOST_GAPS = 0.1
"""Share of frames without a measurement up to which a node's spectrum is taken; gaps are bridged."""


def lag_ms(track: Track) -> float | None:
    """Time, ms, by which the shown picture was behind the mirror; negative: ahead. None at rest.

    Least squares of shown - true = -lag x velocity over all nodes that move. Velocity is the central
    difference of the frames before and after, whose noise is not the frame's own.
    """
    if len(track.points) < 3:
        return None
    time_s, moved, behind = track.time_s, track.moved, track.behind
    span_s = (time_s[2:] - time_s[:-2])[:, None, None]
    velocity = (moved[2:] - moved[:-2]) / span_s
    sigma = track.values("sigma")
    noise = np.sqrt(sigma[2:] ** 2 + sigma[:-2] ** 2)[:, None, None] / span_s
    with np.errstate(invalid="ignore"):
        used = (np.abs(velocity) > MOVING * noise) & np.isfinite(behind[1:-1])
    if np.count_nonzero(used) < LEAST_MOVING:
        return None
    variance = np.broadcast_to(noise**2, velocity.shape)[used].sum()
    power = float((velocity[used] ** 2).sum() - variance)
    return -1e3 * float((behind[1:-1][used] * velocity[used]).sum()) / power if power > 0 else None


def rejection(track: Track) -> tuple[Float, Float]:
    """(frequencies Hz, share of the mirror's motion that is left uncorrected), NaN where nothing moves.

    The transfer from motion to what the shown picture lacks of it, by Welch's spectra summed over nodes. The
    measurement's white noise, which is in both, is taken off by its sigma.
    """
    nothing = np.zeros(0), np.zeros(0)
    if len(track.points) < LEAST_FRAMES:
        return nothing
    time_s = track.time_s
    step_s = float(np.median(np.diff(time_s)))
    even_s = np.arange(time_s[0], time_s[-1], step_s)
    moved, behind = _columns(track)
    if not moved.shape[1] or step_s <= 0 or even_s.size < LEAST_FRAMES:
        return nothing
    moved, behind = (_bridged(even_s, time_s, field) for field in (moved, behind))
    length = min(SEGMENT_FRAMES, even_s.size)
    window = np.hanning(length)
    auto = np.zeros(length // 2 + 1)
    cross = np.zeros(length // 2 + 1, dtype=np.complex128)
    count = 0
    for start in range(0, even_s.size - length + 1, max(length // 2, 1)):
        d, e = (_spectrum(x[:, start : start + length], window) for x in (moved, behind))
        auto += (np.abs(d) ** 2).sum(axis=0)
        cross += (e * d.conj()).sum(axis=0)
        count += len(d)
    sigma = track.values("sigma")
    noise = count * float(np.nanmean(sigma**2)) * float((window**2).sum())
    with np.errstate(invalid="ignore", divide="ignore"):
        left = np.abs(cross + noise) / (auto - noise)
    left[~(auto > (1 + ABOVE_NOISE) * noise)] = np.nan
    frequency_hz: Float = np.asarray(np.fft.rfftfreq(length, step_s), dtype=np.float64)
    return frequency_hz[1:], left[1:]


def _columns(track: Track) -> tuple[Float, Float]:
    """(n, columns) of both fields for the components of nodes that were measured nearly always."""
    n = len(track.points)
    moved, behind = track.moved.reshape(n, -1), track.behind.reshape(n, -1)
    known = np.isfinite(moved) & np.isfinite(behind)
    good = known.mean(axis=0) >= 1.0 - MOST_GAPS
    return moved[:, good], behind[:, good]


def _bridged(even_s: Float, time_s: Float, values: Float) -> Float:
    """(columns, times) of `values` (n, columns) at even times, straight lines over gaps."""
    columns = ((column, np.isfinite(column)) for column in values.T)
    return np.stack([np.interp(even_s, time_s[known], column[known]) for column, known in columns])


def _spectrum(values: Float, window: Float) -> NDArray[np.complex128]:
    return np.asarray(np.fft.rfft((values - values.mean(axis=1, keepdims=True)) * window, axis=1))


def bands(frequency_hz: Float, left: Float) -> dict[str, float | None]:
    """Rms of what is left in each octave of `BANDS_HZ`, by "from-to"; None where nothing moves."""
    found: dict[str, float | None] = {}
    for low, high in pairwise(BANDS_HZ):
        inside = (frequency_hz >= low) & (frequency_hz < high) & np.isfinite(left)
        value = float(np.sqrt(np.mean(left[inside] ** 2))) if inside.any() else None
        found[f"{low:g}-{high:g}"] = value
    return found


def _rms(values: Float) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else None


def figures_of(track: Track) -> Figures:
    """Figures of one session, JSON-ready; None where it is not known.

    residual_rms_px: over all measured frames. residual_nulled_px: median over nulled ones. depth_*: against
    the truth. peak_error_percent: the worst among the nulled frames in which the true peak is at least half
    as deep as it ever is.
    """
    nulled = np.array([point.nulled for point in track.points], dtype=np.bool_)
    residual, depth = track.values("residual_rms_px"), track.values("depth_error_um")
    quiet = residual[nulled & np.isfinite(residual)] if residual.size else residual
    true_mm, error = np.abs(track.values("true_peak_mm")), track.values("peak_error_percent")
    deepest = float(np.nanmax(true_mm)) if np.isfinite(true_mm).any() else 0.0
    with np.errstate(invalid="ignore"):
        deep = (true_mm >= DEEP_SHARE * deepest) & np.isfinite(error) & nulled
    peaks = np.abs(track.values("depth_peak_mm"))
    return {
        "frames": len(track.points),
        "nulled_share": float(nulled.mean()) if nulled.size else None,
        "residual_rms_px": _rms(residual),
        "residual_nulled_px": float(np.median(quiet)) if quiet.size else None,
        "lag_ms": lag_ms(track),
        "depth_peak_mm": float(np.nanmax(peaks)) if np.isfinite(peaks).any() else None,
        "depth_error_um": _rms(depth),
        "depth_nulled_error_um": _rms(depth[nulled]) if nulled.size else None,
        "peak_error_percent": float(error[deep][np.argmax(np.abs(error[deep]))]) if deep.any() else None,
        "left_by_hz": bands(*rejection(track)),
    }
