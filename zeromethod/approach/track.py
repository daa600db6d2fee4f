"""From spots to what comes: constant velocity for half a second at most, time and place of the touch."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np

from zeromethod.approach.approach import Approach, Watching
from zeromethod.approach.spot import Spot
from zeromethod.arrays import Float

WINDOWS_S = (0.5, 0.25, 0.1)
"""How long an object's velocity is taken to stay the same: the longest that fits a straight line."""
STRAIGHT = 3.0
"""Scatter about it over the least sigma, up to which it fits."""
LEAST_SPOTS = 3
"""Spots in a row from which a velocity is believed."""
LEAST_CUT = 5
"""The same of what was not yet seen whole, as shadows at the border are not."""
SIGNIFICANT = 4.0
"""Speeds over their sigma from which something comes."""
SOON_S = 2.5
"""A touch that is farther away arms nothing."""
SLOWEST_MM_S = 3.0
JUMP_MM, JUMP_SHARE = 1.0, 0.02
"""Scatter of heights about a straight line, mm and a share of the height, from which nothing comes."""
MISSED_S = 0.12
"""How long a track goes on without a spot."""
KEPT_S = 0.5
"""How long the loop stays armed after the time of the touch."""
FLOOR_MM, FLOOR_SHARE = 0.1, 0.003
"""Standard deviation of a spot's height at the least: mm and a share of its height."""
ROUND_NOISE = 0.25
"""Standard deviation of the roundness of a spot of 1 mm radius at a slant of 45 degrees."""
ROUND_SYSTEMATIC, ROD_SIGMA, CUT_SIGMA = 0.06, 0.03, 0.3
"""Standard deviations of the roundness that no number of spots takes away, of a rod's, of what is cut."""
PRIOR, PRIOR_SIGMA = 0.6, 0.4
"""Roundness of what was not yet seen long enough."""


class Track:
    """Spots of one thing."""

    def __init__(self, now_ns: int, spot: Spot) -> None:
        self._seen: deque[tuple[float, Float]] = deque(maxlen=64)
        self._start_ns, self._cut, self._long, self._whole = now_ns, True, True, 0
        self._radii: deque[float] = deque(maxlen=30)
        self._rounds: deque[tuple[float, float]] = deque(maxlen=256)
        self.time_ns = now_ns
        self.add(now_ns, spot)

    @property
    def last(self) -> Float:
        """(3,) mm of the newest spot."""
        return self._seen[-1][1]

    def fits(self, now_ns: int, spot: Spot) -> bool:
        """Whether a spot may be the same thing, at most 1 m/s from the one before."""
        reach_mm = 5.0 + 1e-6 * (now_ns - self.time_ns)
        return float(np.linalg.norm(spot.place - self.last)) < reach_mm

    def add(self, now_ns: int, spot: Spot) -> None:
        """Take in a spot."""
        self.time_ns, place = now_ns, spot.place
        self._lever_mm, self._slant2, self._doubt_mm = spot.lever_mm, spot.slant2, spot.doubt_mm
        self._whole = 0 if spot.cut else self._whole + 1
        if self._cut and self._whole == LEAST_SPOTS:
            # only now its middle and size are known
            self._cut = False
            for seen in (self._seen, self._radii):
                while len(seen) >= LEAST_SPOTS:
                    seen.popleft()
        if not spot.cut or self._cut:
            self._radii.append(spot.radius_mm)
            self._long = not np.isfinite(spot.round_)
            self._reach_mm = spot.reach_mm
        else:
            # what was seen whole is only partly in view now: its height is, its middle is not
            place = np.array([*self._expected(now_ns), place[2]])
        if np.isfinite(spot.round_):
            self._rounds.append((spot.round_, spot.weight))
        self._seen.append((1e-9 * (now_ns - self._start_ns), place))

    def _expected(self, now_ns: int) -> Float:
        """(2,) mm, where it is by now if it goes on as over the last spots."""
        (before_s, before), (last_s, last) = self._seen[max(-len(self._seen), -8)], self._seen[-1]
        gone_s = 1e-9 * (now_ns - self._start_ns) - last_s
        rate = (last - before) / max(last_s - before_s, 1e-3)
        return np.asarray((last + gone_s * rate)[:2])

    def _roundness(self) -> tuple[float, float]:
        """(roundness, sigma) of all spots, from 0, flat, to 1, round; what is near either counts as that."""
        if self._long or not self._rounds:
            return 1.0, CUT_SIGMA if self._cut else ROD_SIGMA
        rounds, weights = np.array(self._rounds).T
        known, prior = float(weights.sum()) / ROUND_NOISE**2, PRIOR_SIGMA**-2
        mean = (known * float(np.average(rounds, weights=weights)) + PRIOR * prior) / (known + prior)
        sigma = max(float((known + prior) ** -0.5), ROUND_SYSTEMATIC)
        for simple in (0.0, 1.0):
            if abs(mean - simple) < 2 * sigma < 0.5:
                return simple, 0.5 * sigma
        return float(np.clip(mean, 0.0, 1.0)), sigma

    def _fitted(self) -> tuple[Float, Float, Float, Float, float]:
        """Place and velocity now, (3,), their sigmas, and the scatter of heights, mm.

        They are those of the longest time in which it went straight.
        """
        times, places = np.array([t for t, _ in self._seen]), np.array([p for _, p in self._seen])
        least = FLOOR_MM + FLOOR_SHARE * abs(places[-1, 2]) + self._doubt_mm
        floor = np.array([0.5, 0.5, 1.0]) * least
        for window_s in WINDOWS_S:
            recent = times > times[-1] - window_s
            recent[-LEAST_SPOTS:] = True
            at, there = times[recent] - times[-1], places[recent]
            design = np.stack([np.ones_like(at), at], axis=1)
            fitted = np.linalg.lstsq(design, there, rcond=None)[0]
            left = there - design @ fitted
            scatter = np.sqrt((left**2).sum(axis=0) / max(at.size - 2, 1))
            if scatter[2] < STRAIGHT * floor[2]:
                break
        spread = np.linalg.inv(design.T @ design)
        sigma = np.sqrt(np.diag(spread))[:, None] * np.maximum(scatter, floor)
        return fitted[0], fitted[1], sigma[0], sigma[1], float(scatter[2])

    def approach(self) -> Approach:
        """What is known of it."""
        if len(self._seen) < (LEAST_CUT if self._cut else LEAST_SPOTS):
            return Approach(watching=Watching.SEEN, time_ns=self.time_ns)
        place, velocity, sigma_place, sigma_velocity, scatter_mm = self._fitted()
        radius, (round_, sigma_round) = float(np.median(self._radii)), self._roundness()
        # a ball's silhouette is that of the cone around it: nearer than its middle, and smaller than it; a
        # rod's is nearer by as much more as it is longer across the views
        away = max(float(place[2]), 0.0) + self._lever_mm
        narrow = (radius / away) ** 2 / (1.0 + self._slant2)
        nearer = away * narrow / (1.0 - narrow) * (self._reach_mm / radius if self._long else 1.0)
        below = radius / np.sqrt(1.0 - narrow) - nearer
        radius /= np.sqrt(1.0 - round_ * narrow)
        height, speed, sigma_speed = place[2] - round_ * below, -velocity[2], sigma_velocity[2]
        sigma_height = float(np.hypot(sigma_place[2], sigma_round * below))
        share = 0.3 if self._cut else 0.04 if self._long else 0.01
        figures = {
            "height_mm": height, "sigma_height_mm": sigma_height,
            "speed_mm_s": speed, "sigma_speed_mm_s": sigma_speed,
            "diameter_mm": 2 * radius,
            "sigma_diameter_mm": 2 * (share * radius + 0.06),
        }  # fmt: skip
        state = Watching.SEEN
        # what jumps about is no body: shadows that were taken for one another
        straight = scatter_mm < JUMP_MM + JUMP_SHARE * max(float(place[2]), 0.0)
        if straight and speed > max(SIGNIFICANT * sigma_speed, SLOWEST_MM_S):
            contact = height / speed
            sigma_contact = float(np.hypot(sigma_height, contact * sigma_speed)) / speed
            x, y, _ = place + contact * velocity
            off = np.hypot(np.hypot(sigma_place, contact * sigma_velocity), sigma_contact * np.abs(velocity))
            off[:2] += 2.0 * radius if self._cut else 0.0
            figures |= {
                "contact_s": contact, "sigma_contact_s": sigma_contact,
                "x_mm": x, "y_mm": y, "sigma_x_mm": off[0], "sigma_y_mm": off[1],
            }  # fmt: skip
            if -KEPT_S < contact < SOON_S:
                state = Watching.COMING
        plain: dict[str, Any] = {name: float(value) for name, value in figures.items()}
        return Approach(watching=state, time_ns=self.time_ns, **plain)
