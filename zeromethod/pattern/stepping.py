"""The moving target: by how much it is shifted from drawn picture to drawn picture.

Picture k shows T_k(u, v) = T(u + s_u P, v + s_v P), P the period: s goes from 0 to one period along u and to
two along v in equal steps, and back. So every pixel sees several phases of both carriers within a few frames,
what stands still on LCD and sensor is at another phase in each, and an error of the timing, which is a phase
error proportional to the speed of the steps, changes its sign with them and averages out. V turns a quarter
of the way there and back later than u: what came late would otherwise look like a displacement in each
direction (`fine.lateness`).
"""

from __future__ import annotations

ALONG_V = 2
"""Periods along v for each along u: different ones, so that both carriers are distinguished in time."""


def shift_of(step: int, number: int) -> tuple[float, float]:
    """Shift (s_u, s_v), periods, of the picture with this number, counted from 0.

    step: pictures per period along u (`target.step`); 0 for a target that stands still.

    Convention: the picture at camera position (u, v) is the target's at (u + s_u P, v + s_v P).
    """
    if step == 0:
        return 0.0, 0.0
    along_u, along_v = (_to_and_fro(place, step) for place in (number, number + step // 2))
    # a whole period less is the same picture
    return along_u, ALONG_V * along_v - 1.0


def _to_and_fro(place: int, step: int) -> float:
    """0 to 1 in equal steps, and back."""
    place %= 2 * step
    return min(place, 2 * step - place) / step
