"""Displacement between two images of any texture, from all their pixels."""

from __future__ import annotations

import math

import numpy as np

from zeromethod.arrays import Float, Image, Single
from zeromethod.errors import InputError
from zeromethod.passive.bandwidth import WIDTHS_PX, adaptive_fit
from zeromethod.passive.cells import GRADIENT_NOISE, XX, XY, YY, X, Y
from zeromethod.passive.displacement import Displacement, PointFlag
from zeromethod.passive.matching import LIGHT_PX, Matcher
from zeromethod.passive.moving_fit import blur
from zeromethod.passive.repeats import Repeats, ambiguous, repeats
from zeromethod.passive.search import CELL_PX, SMALLEST_PX, pyramid, resampled, search, settle
from zeromethod.passive.validity import aside, at_ends, doubts, ends, featureless, standing, unsettled, weak
from zeromethod.warp.continuation import continue_smoothly

SPACING_PX = 5
"""Pixels between points; odd, so that points lie on pixel centres."""

NARROWEST_PX, WIDEST_PX = 2.0, 64.0
"""Standard deviations that may be asked for as the window."""
LARGEST_SPACING_PX = 32
"""Largest distance of points that may be asked for."""

_MIDDLE_PX = 8.0
"""Window of the two rounds before each point chooses its own."""
_FINAL_ROUNDS, _UNSETTLED_SHARE = 4, 0.001
"""Rounds with the final windows at most; they end when no more than this share of the points still moves."""
_GUESS_ROUNDS = 20
"""Rounds in which another start than that of the search settles."""
_APART_PX = 2.0
"""Median displacement found above which rest is tried as another start."""
_CAMERA = 2.0
"""Grey variance over its lower quartile up to which it counts as the camera's noise; more is misfit."""


def correlate(
    reference: Image,
    image: Image,
    *,
    spacing_px: int = SPACING_PX,
    window_px: float | None = None,
    guess: Displacement | None = None,
    largest_shift_px: float | None = None,
) -> Displacement:
    """Find where every part of the reference has gone in the image.

    A pyramid finds what is large, then the grey differences of all pixels are fitted under Gaussian windows
    by quadratic displacements, with brightness and contrast free to change smoothly. Gradients are those of
    the two images' mean, grey levels between pixels quintic splines'.

    reference, image: (rows, cols) grey, one shape, any real type, finite. spacing_px: pixels from point to
    point, each the centre of a square of that size. window_px: standard deviation of the Gaussian window;
    None chooses it per point and axis. guess: a displacement from the same reference, say that of the frame
    before, tried in addition to the search from nothing; the better match is kept. largest_shift_px: how far
    any point may have moved, where that is known: it decides by how many periods a texture that repeats did.

    Sigma is the images' noise through the fit's own weights, the noise being taken from the grey differences
    left by the match and taken as equal in both images. It does not contain what the window smooths away.

    Convention: reference(u, v) = image(u + du, v + dv). Raises InputError for what cannot be compared.
    """
    _check(reference, image, spacing_px, window_px, guess)
    if largest_shift_px is not None and not largest_shift_px > 0.0:
        raise InputError(f"largest shift: {largest_shift_px}: more than 0 px")
    a, b = (np.array(grey, dtype=np.float32, order="C") for grey in (reference, image))
    # One overall gain first, so that bit depths and exposures may differ by any factor.
    gain = float(np.std(a) / np.std(b)) if np.std(a) > 0.0 and np.std(b) > 0.0 else 1.0
    b *= np.float32(gain)
    field = _start(a, b, guess)
    matcher = Matcher(a, b, spacing_px)
    field = resampled(field, CELL_PX, matcher.shape, spacing_px, 1.0)
    # What rounding to whole grey levels adds is there even where two images are the same.
    steps = [
        scale * np.issubdtype(grey.dtype, np.integer) for grey, scale in ((reference, 1.0), (image, gain))
    ]
    least_noise = max((steps[0] ** 2 + steps[1] ** 2) / 12.0, 1e-9 * float(np.var(a)), 1e-30)
    middle = (_MIDDLE_PX,) if window_px is None else (window_px,)
    final = WIDTHS_PX if window_px is None else (window_px,)
    sigma = np.full_like(field, np.nan)
    ignored = np.zeros(matcher.shape, dtype=bool)
    for widths_px in (middle, middle, *[final] * _FINAL_ROUNDS):
        comparison = matcher.compare(field, final=True, ignored=ignored)
        good = comparison.alike
        noise = np.maximum(comparison.grey_variance, least_noise)
        # Where much more is left than elsewhere, that is a misfit of the texture and not the camera's noise.
        camera = np.minimum(noise, _CAMERA * np.percentile(noise[good], 25.0) if good.any() else np.inf)
        of_noise = GRADIENT_NOISE * camera * comparison.pixels
        textured = good & ~featureless(comparison, of_noise, spacing_px)
        still, ignored = standing(comparison, field, sigma, textured, of_noise, spacing_px)
        textured &= ~still
        sums = np.where(textured[..., None], comparison.sums, 0.0)
        of_noise = np.where(textured, of_noise, 0.0)
        fitted, variance, area = adaptive_fit(sums, of_noise, field, noise, spacing_px, widths_px)
        known = np.isfinite(fitted).all(axis=-1) & good
        step = np.linalg.norm(fitted - field, axis=-1)
        before = field
        # What looks alike but is not determined stays where the search had it.
        field = continue_smoothly(np.where(known[..., None], fitted, field), known | good)
        sigma = np.sqrt(variance)
        if widths_px == final and np.sum(unsettled(sigma, step) & known) <= _UNSETTLED_SHARE * np.sum(known):
            break
    u, v = np.meshgrid(*(spacing_px * np.arange(n) + 0.5 * (spacing_px - 1) for n in matcher.shape[::-1]))
    within = (u <= a.shape[1] - 1) & (v <= a.shape[0] - 1)
    found = doubts(field, sigma, np.where(known, step, np.inf), comparison.shown & within, good, spacing_px)
    sigma *= _misfit(sums, fitted - before, noise, spacing_px)[..., None]
    # Where a window's choice changes from round to round, the field does so by this much.
    sigma = np.where(unsettled(sigma, step)[..., None], np.hypot(sigma, step[..., None]), sigma)
    texture = sums[..., XX] + sums[..., YY] - 2.0 * of_noise
    close = ends(texture, comparison.shown & within, spacing_px)
    sigma = np.hypot(sigma, at_ends(field, close, spacing_px)[..., None])
    found[aside(texture, spacing_px) | weak(sigma)] |= np.uint8(PointFlag.TEXTURE)
    largest_px = math.inf if largest_shift_px is None else largest_shift_px
    found[np.linalg.norm(field, axis=-1) > largest_px] |= np.uint8(PointFlag.ORDER)
    sound = found == 0
    others = Repeats(repeats(a), least_noise, largest_px)
    if ambiguous(matcher, comparison, field, sigma, sound, close, others, guess):
        found[sound] |= np.uint8(PointFlag.ORDER)
    valid = found == 0
    return Displacement(
        u=u,
        v=v,
        du=field[..., 0],
        dv=field[..., 1],
        sigma_u=sigma[..., 0],
        sigma_v=sigma[..., 1],
        doubts=found,
        match=comparison.match,
        noise_area_px2=area,
        noise_grey=float(np.sqrt(np.median(noise[valid]))) if valid.any() else math.nan,
    )


def _start(a: Single, b: Single, guess: Displacement | None) -> Float:
    """Field on cells of `CELL_PX`: the search's, or where more matches, rest or the guess, settled."""
    found = search(pyramid(a), pyramid(b))
    matcher = Matcher(a, b, CELL_PX)
    starts = []
    # What is found close to rest has been found from rest.
    if np.median(np.linalg.norm(found, axis=-1)) > _APART_PX:
        starts.append(np.zeros_like(found))
    if guess is not None:
        size = round(float(guess.u[0, 1] - guess.u[0, 0]))
        # What was not valid may be anything.
        before = continue_smoothly(guess.field, guess.valid) if guess.valid.any() else guess.field
        starts.append(resampled(before, size, matcher.shape, CELL_PX, 1.0))
    if not starts:
        return found
    fields = [found, *(settle(matcher, start, _GUESS_ROUNDS) for start in starts)]
    shares = [float(matcher.compare(field).alike.mean()) for field in fields]
    return fields[int(np.argmax(shares))]


def _misfit(sums: Float, step: Float, noise: Float, size: int) -> Float:
    """How much more (rows, cols) the grey differences left pull at the fit than white noise does; at least 1.

    What is left at edges, or alike over several pixels, averages out less than noise. step: (rows, cols, 2)
    px, the last change of the field.
    """
    step = np.nan_to_num(step)
    left = sums[..., X] - sums[..., XX] * step[..., 0] - sums[..., XY] * step[..., 1]
    down = sums[..., Y] - sums[..., XY] * step[..., 0] - sums[..., YY] * step[..., 1]
    window = (LIGHT_PX / size, LIGHT_PX / size)
    found = blur(left**2 + down**2, window)
    expected = blur(noise * (sums[..., XX] + sums[..., YY]), window)
    return np.asarray(np.sqrt(np.maximum(found / np.maximum(expected, 1e-30), 1.0)))


def _check(
    reference: Image,
    image: Image,
    spacing_px: int,
    window_px: float | None,
    guess: Displacement | None,
) -> None:
    for name, grey in (("reference", reference), ("image", image)):
        if grey.ndim != 2 or min(grey.shape) < SMALLEST_PX:
            raise InputError(f"{name}: shape {grey.shape}: (rows, cols), at least {SMALLEST_PX} px each")
        if grey.dtype.kind not in "uif" or not np.isfinite(grey).all():
            raise InputError(f"{name}: {grey.dtype}: real grey levels, all finite")
    if reference.shape != image.shape:
        raise InputError(f"image: shape {image.shape}: the reference's, {reference.shape}")
    if not 1 <= spacing_px <= LARGEST_SPACING_PX:
        raise InputError(f"spacing: {spacing_px}: 1 to {LARGEST_SPACING_PX} px")
    if window_px is not None and not NARROWEST_PX <= window_px <= WIDEST_PX:
        raise InputError(f"window: {window_px}: {NARROWEST_PX:g} to {WIDEST_PX:g} px")
    if guess is not None and not (
        guess.u.shape[1] > 1 and abs(guess.u[0, -1] - reference.shape[1]) < 2 * LARGEST_SPACING_PX
    ):
        raise InputError("guess: a displacement from the same reference")
