"""Fits a plate, a ball or a rod to the light of the pixels along its outlines in both views."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from zeromethod.arrays import Float, Mask

BLURS = (2.5, 2.0, 1.5, *(1.0,) * 16)
"""Width of the blurred outline that is fitted, pixels, pass by pass: a wide one is found from farther."""
BAND_PX = 3.0
"""Pixels within this distance of the outline, as it is first assumed, count."""
MOST_PIXELS = 500
DONE = 0.003
"""Passes end when one changes the mean square residual by less than this share."""
STEP_MM, WEAK_MM = 3.0, 30.0
"""Greatest change in one pass; prior standard deviation of every length, for what the pixels do not show."""
SHADES = 0.15
"""Prior standard deviation of how much lighter a round body is in its middle than at its rim, as a share of
the background's light."""


@dataclass(frozen=True, slots=True)
class Pixels:
    """Pixels of both views, (n, ...): rays (foot, tangent) and areas as of `Exits`; light; right: which view.

    seen_grey: light less that of the background, which is behind_grey.
    """

    foot: Float
    tangent: Float
    areas: Float
    seen_grey: Float
    behind_grey: Float
    right: Mask
    noise_grey: float

    def near(self, start: Float) -> Pixels:
        """Those near the outline of the body that is first assumed, at most some hundred."""
        off = np.abs(_outside(self, start, round_=False)[0] - start[5])
        kept = np.flatnonzero(off < BAND_PX * self.pitch_mm(start[2], round_=False))
        kept = kept[:: kept.size // MOST_PIXELS + 1]
        arrays = {one.name: getattr(self, one.name)[kept] for one in fields(self) if one.name != "noise_grey"}
        return replace(self, **arrays)

    def pitch_mm(self, z: float, *, round_: bool) -> Float:
        """(n,) width of a pixel at the height z, mm: in that plane, or across the ray for a round body."""
        area = np.abs(self.areas @ [1.0, z, z * z])
        if round_:
            area = area / np.sqrt(1.0 + np.einsum("ij,ij->i", self.tangent, self.tangent))
        return np.asarray(np.sqrt(area))


@dataclass(frozen=True, slots=True)
class Body:
    """A fitted body.

    place: (3,) mm, its lowest point. reach_mm: half its length. sigma_...: standard deviations that the
    pixels' noise makes. misfit: mean square residual of the light, over the noise's variance. rough: rms
    residual beyond the noise, over the body's contrast. pixels: how many counted. fit: (6,) mm: x, y, z of
    its middle; x, y of half its axis (0, 0 for a body that is not long); radius.
    """

    place: Float
    sigma_mm: Float
    radius_mm: float
    sigma_radius_mm: float
    reach_mm: float
    misfit: float
    rough: float
    pixels: int
    fit: Float


def fitted(pixels: Pixels, start: Float, *, round_: bool) -> Body | None:
    """The body by least squares; None for too few pixels.

    start: first assumption, as `Body.fit`. A half axis of 0, 0 stays so. round_: a ball or a round rod, not a
    plate or a flat one.
    """
    body, free = start.copy(), [0, 1, 2, 3, 4, 5] if start[3:5].any() else [0, 1, 2, 5]
    pixels = pixels.near(start)
    if pixels.seen_grey.size < 2 * len(free):
        return None
    before = np.inf
    for blur in BLURS:
        dist, turns = _outside(pixels, body, round_=round_)
        width = blur * pixels.pitch_mm(body[2], round_=round_)
        cover = np.clip(0.5 - (dist - body[5]) / width, 0.0, 1.0)
        facing = np.sqrt(np.clip(1.0 - (dist / body[5]) ** 2, 0.0, 1.0))
        shades = np.stack([~pixels.right, pixels.right, facing], axis=1)
        prior = np.array([[0.0, 0.0, pixels.noise_grey / (SHADES * float(pixels.behind_grey.mean()))]])
        light = cover[:, None] * shades
        target = pixels.seen_grey + cover * pixels.behind_grey
        own = np.linalg.lstsq(np.vstack([light, prior]), np.append(target, 0.0), rcond=None)[0]
        left = target - light @ own
        contrast = shades @ own - pixels.behind_grey
        by_dist = np.where((cover > 0) & (cover < 1), contrast / width, 0.0)
        slopes = by_dist[:, None] * np.column_stack([-turns, np.ones_like(dist)])[:, free]
        design = np.vstack([np.hstack([slopes, light]), np.hstack([np.zeros((1, len(free))), prior])])
        normal = design.T @ design / pixels.noise_grey**2
        normal[np.diag_indices(len(free))] += WEAK_MM**-2
        normal[np.diag_indices(len(normal))] += 1e-9
        step = np.linalg.solve(normal, design.T @ np.append(left, 0.0) / pixels.noise_grey**2)[: len(free)]
        body[free] += np.clip(step, -STEP_MM, STEP_MM)
        body[5] = max(body[5], 0.3)
        mean = float(np.mean(left**2))
        if blur == BLURS[-1] and abs(before - mean) < DONE * mean:
            break
        before = mean
    spread = np.zeros((6, 6))
    spread[np.ix_(free, free)] = np.linalg.inv(normal)[: len(free), : len(free)]
    lowest = np.eye(3, 6)
    lowest[2, 5] = -1.0 if round_ else 0.0
    rough = np.sqrt(max(mean - pixels.noise_grey**2, 0.0)) / float(np.sqrt(np.mean(contrast**2)))
    return Body(
        lowest @ body, np.sqrt(np.diag(lowest @ spread @ lowest.T)), float(body[5]),
        float(np.sqrt(spread[5, 5])), float(np.hypot(*body[3:5])) + float(body[5]),
        mean / pixels.noise_grey**2, float(rough), dist.size, body,
    )  # fmt: skip


def _outside(pixels: Pixels, body: Float, *, round_: bool) -> tuple[Float, Float]:
    """(n,) mm from a body's axis to the rays, and its derivatives (n, 5) by x, y, z and the half axis."""
    middle, half = body[:3], np.array([body[3], body[4], 0.0])
    length = float(half @ half)
    if round_:
        ray = np.column_stack([pixels.tangent, np.ones(len(pixels.tangent))])
        ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
        to = np.column_stack([middle[:2] - pixels.foot, np.full(len(ray), middle[2])])
    else:
        ray = np.zeros((len(pixels.tangent), 3))
        to = np.column_stack([middle[:2] - pixels.foot - middle[2] * pixels.tangent, np.zeros(len(ray))])
    along, mixed = np.einsum("ij,ij->i", to, ray), ray @ half
    # the point of the axis nearest to the ray, between its ends
    at = np.clip((mixed * along - to @ half) / np.maximum(length - mixed**2, 1e-9), -1.0, 1.0)
    away = to + at[:, None] * half
    away = away - np.einsum("ij,ij->i", away, ray)[:, None] * ray
    dist = np.maximum(np.linalg.norm(away, axis=1), 1e-9)
    away = away / dist[:, None]
    if not round_:
        away[:, 2] = -np.einsum("ij,ij->i", away[:, :2], pixels.tangent)
    return dist, np.column_stack([away, at[:, None] * away[:, :2]])
