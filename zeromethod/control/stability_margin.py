"""How far the loop's gain is from instability, given its delay.

Scalar models of one spatial mode, at frames n. Frame n + m is exposed to the command made from frame n, m
whole; a delay D between m and m + 1 mixes the two commands as an exposure does, (1 - f) and f with f = D - m.
No frame can contain the picture made from it, so that D below 1 counts as 1.

Integrator      c(n) = (1 - leak) (c(n-1) + g (x - shown(n))):

    1 - (1 - leak) [z^-1 - g ((1 - f) z^-m + f z^-(m+1))] = 0; without leak, D = m: g < 2 sin(pi / (4 m - 2)).

Composition     x(n) = x(n-1) + K (shown(n) + W (q - shown(n)) - x(n-1)), W the share of the mode that the
sensor observes:

    1 - (1 - K) z^-1 - K (1 - W) ((1 - f) z^-m + f z^-(m+1)) = 0,

whose coefficients add up to less than 1 for K <= 1 and W within (0, 2): stable at every delay. The worst mode
among those that are not filtered away (W from 0.1) bounds the gain. Velocity prediction is left out: it acts
only on steady motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.rig.model import ControlSpec

OBSERVED_SHARES = (0.1, 0.25, 0.5, 0.75, 1.0)
"""W of the modes examined; modes below the first are filtered out of every command."""

_LARGEST, _HALVINGS = 4.0, 40
"""Largest gain that is looked at, and halvings of the interval in which the limit lies."""


@dataclass(frozen=True)
class Margin:
    """Gain margin of the loop at `delay_frames` camera frames.

    largest_gain: up to which the loop is stable. margin: largest_gain over the rig's gain; above 1 is stable.
    """

    delay_frames: float
    largest_gain: float
    margin: float


def _largest_root(feedback: dict[int, float], delay_frames: float, share: float) -> float:
    """Largest |z| of 1 - sum feedback[k] z^-k - share ((1 - f) z^-m + f z^-(m+1)) = 0."""
    whole = int(np.floor(delay_frames))
    part = delay_frames - whole
    terms = np.zeros(whole + 2)
    terms[0] = 1.0
    for lag, value in feedback.items():
        terms[lag] -= value
    terms[whole] -= share * (1 - part)
    terms[whole + 1] -= share * part
    return float(np.abs(np.roots(terms)).max())


def _root(control: ControlSpec, gain: float, delay_frames: float) -> float:
    if control.controller == "integrator":
        keep = 1 - control.leak
        return _largest_root({1: keep}, delay_frames, -keep * gain)
    return max(
        _largest_root({1: 1 - gain}, delay_frames, gain * (1 - observed)) for observed in OBSERVED_SHARES
    )


def stability_margin(control: ControlSpec, delay_frames: float) -> Margin:
    """Largest stable gain of the rig's controller at a delay and at all whole delays below it.

    delay_frames: from a frame's mid-exposure to that of the frame that contains the picture made from it,
    weighted by light; camera frames.
    """
    delay_frames = max(delay_frames, 1.0)
    # a mix of two commands damps the fastest oscillations; with a delay that jitters this cannot be relied on
    delays = {*map(float, range(1, int(delay_frames) + 1)), delay_frames}
    largest = min(_largest_gain(control, delay) for delay in delays)
    return Margin(delay_frames, largest, largest / control.gain)


def _largest_gain(control: ControlSpec, delay_frames: float) -> float:
    low, high = 0.0, _LARGEST
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _root(control, middle, delay_frames) < 1 else (low, middle)
    return low


def margin_words(margin: Margin, control: ControlSpec) -> str:
    """The margin as a sentence: stable or not, and by what factor."""
    verdict = "stable" if margin.margin > 1 else "UNSTABLE: lower [control] gain"
    return (
        f"stability: controller {control.controller!r} with gain {control.gain:g} is {verdict}; "
        f"the gain could be {margin.margin:.2g} times as large"
    )
