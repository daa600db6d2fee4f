"""Follows one object: its velocity, and from that time and place of its touch."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from zeromethod.approach.approach import Approach, Watching
from zeromethod.approach.body import Body
from zeromethod.approach.spot import ROUGHEST, Spot
from zeromethod.arrays import Float

WINDOWS_S = (0.5, 0.25, 0.1)
"""Velocity is taken from the longest of these times in which the places lie on a straight line."""
STRAIGHT = 3.0
"""They do where they scatter about the line by less than so many sigmas."""
LEAST_SPOTS, LEAST_CUT = 3, 5
"""Consecutive spots that a velocity needs; the second number as long as the object was never seen whole: it
may be a shadow at the border."""
SIGNIFICANT = 4.0
"""Speed towards the mirror, over its sigma, from which an object is coming."""
SOON_S = 2.5
"""A touch later than this does not arm the loop."""
SLOWEST_MM_S = 3.0
JUMP_MM, JUMP_SHARE = 1.0, 0.02
"""An object whose heights scatter more about a line does not count as coming: mm, share of the height."""
MISSED_S = 0.12
"""How long an object is followed without a spot, if it is not coming (else: `Track.kept_s`)."""
KEPT_S = 0.5
"""How long the loop stays armed after the time of the touch."""
FLOOR_MM, FLOOR_SHARE = 0.03, 0.0005
"""Least standard deviation of a spot's place: mm, and a share of its height."""
SIZE_MM, SIZE_SHARE = 0.03, 0.005
"""Least standard deviation of the radius, however many spots it is the mean of: mm, and a share of it."""
UNEVEN, EVEN_SHARE, EVEN_SHARE_CUT = 1.0, 0.75, 0.9
"""An object counts as coming only if this share (the second number; the third if it was never seen whole) of
its radii lie near their median: within the first number of deviations, each of sigma and a tenth of the
median. A ball of a dozen pixels may be fitted wrong in one frame of five."""
CUT_SHARE = 0.3
"""Standard deviation of middle and radius of an object that a view cuts, over its reach."""
COMMON, MOST_FAVOUR = 3.0, 2.0
"""For flat against round: so many pixels count as one, as they err together; most that one frame adds to the
logarithm of the odds."""
ROUGH = 0.1
"""A body that leaves more of its light unexplained (`Body.rough`) is no ball, rod or plate."""


@dataclass(frozen=True, slots=True)
class _Line:
    """Straight line through places: (3,) newest place, mm, and velocity, mm/s; sigmas; scatter of heights."""

    place: Float
    velocity: Float
    sigma_place: Float
    sigma_velocity: Float
    scatter_mm: float


class Track:
    """The spots of one object, in turn. newest: the last of them, at `time_ns`."""

    def __init__(self, now_ns: int, spot: Spot) -> None:
        self._start_ns, self._run = now_ns, 0
        self._whole = False
        self._said = Approach(watching=Watching.SEEN, time_ns=now_ns)
        self._seen: deque[tuple[float, Spot]] = deque(maxlen=64)
        self.add(now_ns, spot)

    @property
    def known(self) -> Spot | None:
        """The newest spot of an object that is coming; None of others."""
        return self.newest if self._said.armed else None

    def off_mm(self, spot: Spot) -> float:
        """How far a spot is from the newest one."""
        return float(np.linalg.norm(spot.flat.place - self.newest.flat.place))

    def fits(self, now_ns: int, spot: Spot) -> bool:
        """Whether a spot may be the same object: it moves at half a metre per second at most."""
        return self.off_mm(spot) < 5.0 + 0.5e-6 * (now_ns - self.time_ns)

    def add(self, now_ns: int, spot: Spot) -> None:
        """Add the object's spot in a frame."""
        self.time_ns, self.newest = now_ns, spot
        self._run += 1
        self._whole |= not spot.cut
        self._seen.append((1e-9 * (now_ns - self._start_ns), spot))

    def kept_s(self, *, still_seen: bool) -> float:
        """How long it is followed without a spot: until its touch where both lenses still see something."""
        if not self._said.armed:
            return MISSED_S
        return max(self._said.contact_s + KEPT_S, WINDOWS_S[0]) if still_seen else WINDOWS_S[0]

    def missed(self, now_ns: int) -> Approach:
        """What is known of the object in a frame without a spot: the last, extrapolated by its velocity."""
        self._run, last = 0, self._said
        gone_s = 1e-9 * (now_ns - self.time_ns)
        return replace(
            last, time_ns=now_ns, contact_s=last.contact_s - gone_s,
            height_mm=last.height_mm - gone_s * last.speed_mm_s,
            sigma_height_mm=float(np.hypot(last.sigma_height_mm, gone_s * last.sigma_speed_mm_s)),
        )  # fmt: skip

    def _fitting(self, bodies: list[Body]) -> tuple[_Line, Float]:
        """The straight line through the bodies of one kind (flat or round), and `_radius` of them.

        Bodies that do not explain the light are left out: those of the wrong kind may not fit at all.
        """
        fits = np.flatnonzero([one.rough <= ROUGHEST for one in bodies])
        kept = fits if fits.size >= LEAST_SPOTS else np.arange(len(bodies))
        bodies = [bodies[k] for k in kept]
        since = np.array([self._seen[k][0] - self._seen[-1][0] for k in kept])
        places = np.array([one.place for one in bodies])
        floor = FLOOR_MM + FLOOR_SHARE * np.abs(places[:, 2:])
        sigmas = np.hypot(floor, [one.sigma_mm * np.sqrt(max(one.misfit, 1.0)) for one in bodies])
        spots = [self._seen[k][1] for k in kept]
        by_cut = np.array([CUT_SHARE * one.flat.reach_mm if one.cut else 0.0 for one in spots])
        sigmas[:, :2] += by_cut[:, None]
        for window_s in WINDOWS_S:
            recent = since > -window_s
            recent[-LEAST_SPOTS:] = True
            at = since[recent]
            design = np.stack([np.ones_like(at), at], axis=1)
            line, sigma, scatter = np.empty((2, 3)), np.empty((2, 3)), np.empty(3)
            for k in range(3):
                weighted = design / sigmas[recent, k, None]
                spread = np.linalg.inv(weighted.T @ weighted)
                line[:, k] = spread @ weighted.T @ (places[recent, k] / sigmas[recent, k])
                left = (places[recent, k] - design @ line[:, k]) / sigmas[recent, k]
                scatter[k] = np.sqrt(left @ left / max(at.size - 2, 1))
                sigma[:, k] = np.sqrt(np.diag(spread)) * max(scatter[k], 1.0)
            if scatter[2] < STRAIGHT:
                break
        found = _Line(line[0], line[1], sigma[0], sigma[1], float(scatter[2] * sigmas[-1, 2]))
        return found, _radius(bodies, by_cut)

    def approach(self) -> Approach:
        """What is known of the object, by all of its spots."""
        least = LEAST_SPOTS if self._whole else LEAST_CUT
        if len(self._seen) < least:
            return Approach(watching=Watching.SEEN, time_ns=self.time_ns)
        kinds = [spot.flat for _, spot in self._seen], [spot.round_ for _, spot in self._seen]
        share = 1.0 / (1.0 + np.exp(-np.clip(sum(map(_favour, *kinds)), -50.0, 50.0)))
        shares = np.array([1.0 - share, share])
        (flat, flat_size), (round_, round_size) = (self._fitting(bodies) for bodies in kinds)
        place = shares @ [flat.place, round_.place]
        velocity = shares @ [flat.velocity, round_.velocity]
        sigma_place = np.sqrt(shares @ [flat.sigma_place**2, round_.sigma_place**2])
        sigma_velocity = np.sqrt(shares @ [flat.sigma_velocity**2, round_.sigma_velocity**2])
        # neither flat nor round: its lowest place may be anywhere between
        rough = max(min(bodies[-1].rough for bodies in kinds) - ROUGH, 0.0)
        doubt = float(np.hypot(np.sqrt(shares[0] * shares[1]), rough)) * abs(flat.place[2] - round_.place[2])
        height, speed, sigma_speed = place[2], -velocity[2], sigma_velocity[2]
        sigma_height = float(np.hypot(sigma_place[2], doubt))
        radius, sigma_radius, uneven = shares @ [flat_size, round_size]
        figures = {
            "height_mm": height, "sigma_height_mm": sigma_height,
            "speed_mm_s": speed, "sigma_speed_mm_s": sigma_speed,
            "diameter_mm": 2 * radius, "sigma_diameter_mm": 2 * sigma_radius,
        }  # fmt: skip
        state = Watching.SEEN
        # what jumps about or swells is no body: shadows that were taken for one another
        straight = (flat, round_)[int(share > 0.5)].scatter_mm < JUMP_MM + JUMP_SHARE * max(height, 0.0)
        straight &= bool(uneven < UNEVEN)
        if straight and speed > max(SIGNIFICANT * sigma_speed, SLOWEST_MM_S):
            contact = height / speed
            sigma_contact = float(np.hypot(sigma_height, contact * sigma_speed)) / speed
            x, y, _ = place + contact * velocity
            off = np.hypot(np.hypot(sigma_place, contact * sigma_velocity), sigma_contact * np.abs(velocity))
            figures |= {
                "contact_s": contact, "sigma_contact_s": sigma_contact,
                "x_mm": x, "y_mm": y, "sigma_x_mm": off[0], "sigma_y_mm": off[1],
            }  # fmt: skip
            armed = self._said.armed
            soon = (-KEPT_S if armed else 0.0) < contact < SOON_S
            if soon and (armed or self._run >= least):
                state = Watching.COMING
        plain: dict[str, Any] = {name: float(value) for name, value in figures.items()}
        self._said = Approach(watching=state, time_ns=self.time_ns, **plain)
        return self._said


def _favour(flat: Body, round_: Body) -> float:
    """Logarithm of the odds of round against flat, by one frame."""
    least = max(min(flat.misfit, round_.misfit), 1.0)
    found = 0.5 * (flat.misfit - round_.misfit) / least * flat.pixels / COMMON
    return float(np.clip(found, -MOST_FAVOUR, MOST_FAVOUR))


def _radius(bodies: list[Body], by_cut: Float) -> Float:
    """(3,) radius and its sigma, mm, of the last second, and how far most lie from the median.

    by_cut: (n,) what the radius of a body may be off because its view cuts it, mm; 0 where it is seen whole.
    """
    share = EVEN_SHARE
    if np.count_nonzero(by_cut == 0.0) < LEAST_SPOTS:
        # of what was never seen whole, as shadows at the border are not, all sizes have to agree
        by_cut, share = np.zeros_like(by_cut), EVEN_SHARE_CUT
    radii = np.array([one.radius_mm for one in bodies[-30:]])
    noises = [one.sigma_radius_mm * np.sqrt(max(one.misfit, 1.0)) for one in bodies[-30:]]
    sigmas = np.hypot(np.hypot(noises, SIZE_MM), by_cut[-30:])
    mean = float(np.average(radii, weights=sigmas**-2))
    middle = float(np.median(radii))
    scatter = np.quantile(np.abs(radii - middle) / np.hypot(sigmas, 0.1 * middle), share)
    return np.array([mean, np.hypot((sigmas**-2).sum() ** -0.5, SIZE_MM + SIZE_SHARE * mean), scatter])
