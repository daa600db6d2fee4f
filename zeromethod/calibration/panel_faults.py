"""Faults of a display that change the picture unasked: found from the light at the camera.

Each check gives a `FaultCheck`: how large, how sure, and from where on it counts. What cannot be found:
dithering whose period the exposures span (it then does no harm), and anything slower than the frames looked
at.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import InputError

SURE_SIGMAS = 5.0


class Fault(enum.StrEnum):
    """Faults of the display, and of other light in the room."""

    DYNAMIC_CONTRAST = "dynamic contrast"
    ADAPTIVE_TONE = "adaptive tone curve"
    TEMPORAL_DITHERING = "temporal dithering"
    SPATIAL_DITHERING = "spatial dithering"
    OVERDRIVE = "overdrive"
    BACKLIGHT_FLICKER = "backlight flicker"
    ROOM_LIGHT = "flickering room light"

    @property
    def limit(self) -> float:
        """Size from which it counts: a share of the light, but grey codes of the LCD (rms) for dithering."""
        return _LIMIT_ADVICE[self][0]

    @property
    def advice(self) -> str:
        """What to do about it."""
        return _LIMIT_ADVICE[self][1]


_DRIVER = (
    "switch off dithering in the graphics driver, set it to the LCD's own bit depth, or take an LCD of 8"
)
_LIMIT_ADVICE = {
    Fault.DYNAMIC_CONTRAST: (
        0.01,
        "switch off dynamic contrast, local dimming, power saving and automatic brightness in the LCD's "
        "menu, the graphics driver and the desktop",
    ),
    Fault.ADAPTIVE_TONE: (
        0.01,
        "switch off adaptive contrast, picture enhancement and night light in the LCD's menu, the graphics "
        "driver and the desktop",
    ),
    Fault.TEMPORAL_DITHERING: (
        0.1,
        f"{_DRIVER} true bits; else expose for whole multiples of four refreshes",
    ),
    Fault.SPATIAL_DITHERING: (0.1, f"{_DRIVER} true bits"),
    Fault.OVERDRIVE: (
        0.02,
        "switch off overdrive (response time, trace free: 'off' or 'normal') in the LCD's menu",
    ),
    Fault.BACKLIGHT_FLICKER: (
        0.003,
        "switch off what dims the backlight (set it to full brightness), or expose for whole multiples of "
        "its period",
    ),
    Fault.ROOM_LIGHT: (0.003, "switch off the room's lamps, or shield the bench from them"),
}


@dataclass(frozen=True)
class FaultCheck:
    """Outcome of one check.

    size, sigma: in the unit of `Fault.limit`; sigma of noise alone. measured: what was seen, in words.
    """

    fault: Fault
    size: float
    sigma: float
    measured: str

    @property
    def least(self) -> float:
        """Size from which it counts and is no noise."""
        return max(self.fault.limit, SURE_SIGMAS * self.sigma)

    @property
    def found(self) -> bool:
        """Whether it counts and is no noise."""
        return abs(self.size) > self.least

    @property
    def words(self) -> str:
        """What it is and what to do; for one that was not found, that."""
        if self.found:
            return f"{self.fault}: {self.measured}: {self.fault.advice}"
        if self.fault in (Fault.TEMPORAL_DITHERING, Fault.SPATIAL_DITHERING):
            return f"{self.fault}: none above {self.least:.2g} grey codes"
        return f"{self.fault}: none above {100 * self.least:.2g} %"


def surround(patch: Float) -> tuple[FaultCheck, FaultCheck]:
    """Dynamic contrast and adaptive tone, from the light of a patch by what is around it.

    Glare (of lens, faces, LCD glass) adds light, dynamic contrast multiplies it: the patch's own swing
    separates them. patch: (repeats, surrounds, 3) grey, surrounds from black to white, patch dark, middling
    and bright. Two repeats at least.
    """
    if patch.ndim != 3 or patch.shape[0] < 2 or patch.shape[1] < 2 or patch.shape[2] != 3:
        raise InputError(f"patch: shape {patch.shape}: (two or more repeats, two or more surrounds, 3)")
    repeats = len(patch)
    mean = patch.mean(axis=0)
    # one number of noise for all: single ones have too few repeats
    sigma = math.sqrt(float(np.mean(patch.var(axis=0, ddof=1))) / repeats)
    swing = mean[:, 2] - mean[:, 0]
    gain = swing / swing[-1] - 1.0
    worst = int(np.argmax(np.abs(gain)))
    gain_sigma = sigma * math.sqrt(2.0) * math.hypot(1.0, 1.0 + gain[worst]) / swing[-1]
    tone = (mean[:, 1] - mean[:, 0]) / swing
    bend = tone - tone[-1]
    oddest = int(np.argmax(np.abs(bend)))
    tone_sigma = 2.0 * sigma / min(swing[oddest], swing[-1])
    names = ["black"] + ["grey"] * (len(swing) - 2) + ["white"]
    return (
        FaultCheck(
            Fault.DYNAMIC_CONTRAST,
            float(gain[worst]),
            float(gain_sigma),
            f"the same patch gives {100 * gain[worst]:+.1f} % of light on {names[worst]} against on white",
        ),
        FaultCheck(
            Fault.ADAPTIVE_TONE,
            float(bend[oddest]),
            float(tone_sigma),
            f"a middling grey gives {100 * bend[oddest]:+.1f} % of the white's light more on {names[oddest]} "
            "than on white",
        ),
    )


def _unsteadiness(level: Float, noise_grey: float) -> tuple[float, float]:
    """Variance of a level about a straight line, its noise taken off; that variance's standard deviation."""
    order = np.arange(len(level))
    rest = level - np.polyval(np.polyfit(order, level, 1), order)
    degrees = len(level) - 2
    variance = float(rest @ rest) / degrees
    return variance - noise_grey**2, variance * math.sqrt(2.0 / degrees)


def root(variance: float, sigma: float) -> tuple[float, float]:
    """Root of a variance that may be nothing but noise, and its standard deviation."""
    size = math.sqrt(max(variance, 0.0))
    return size, sigma / (2 * size) if size > math.sqrt(sigma) else math.sqrt(sigma)


def flicker(times_s: Float, white: Float, black: Float, noise_grey: float) -> tuple[FaultCheck, FaultCheck]:
    """Flicker of the backlight, and of other light, from frame to frame.

    times_s: (n,) of the frames of the white LCD. white, black: (n,), (m,) mean grey over the lit view, the
    black LCD's own. noise_grey: standard deviation of such a mean by the camera's noise. Sizes are rms over
    the white's light. Slow drift is taken out. Eight frames each at least.
    """
    if min(len(white), len(black)) < 8 or len(times_s) != len(white):
        raise InputError(f"flicker: {len(white)} and {len(black)} frames: eight or more")
    light = float(white.mean() - black.mean())
    dark, dark_sigma = _unsteadiness(black, noise_grey)
    both, both_sigma = _unsteadiness(white, noise_grey)
    own, own_sigma = root(both - max(dark, 0.0), math.hypot(both_sigma, dark_sigma))
    room, room_sigma = root(dark, dark_sigma)
    rhythm = _rhythm(times_s, white)
    return (
        FaultCheck(
            Fault.BACKLIGHT_FLICKER,
            own / light,
            own_sigma / light,
            f"the light varies by {100 * own / light:.2g} % (rms) from frame to frame{rhythm}",
        ),
        FaultCheck(
            Fault.ROOM_LIGHT,
            room / light,
            room_sigma / light,
            f"with the LCD black the light varies by {100 * room / light:.2g} % of the white's (rms)"
            f"{_rhythm(times_s[: len(black)], black[: len(times_s)])}",
        ),
    )


def _rhythm(times_s: Float, level: Float) -> str:
    """Words for a frequency that holds most of the variance, as frames show it (the true one may differ)."""
    order = np.arange(len(level))
    rest = level - np.polyval(np.polyfit(order, level, 1), order)
    power = np.abs(np.fft.rfft(rest, 4 * len(rest))) ** 2
    best = int(np.argmax(power))
    frame_s = float(np.median(np.diff(times_s)))
    # a single line's share of all power, at four times the resolution
    if frame_s <= 0 or 2 * power[best] < 0.5 * len(rest) * float(rest @ rest):
        return ""
    return f", in frames at {best / (4 * len(rest) * frame_s):.2g} Hz"


SETTLED_SHARE = 0.01
"""Of a step, within which the light has settled."""


@dataclass(frozen=True)
class StepResponse:
    """What follows a change of the picture.

    overdrive: the largest overshoot of a frame's light past what it settles to, over the step: at least this,
    as an exposure takes a mean. began_s, settled_s: from presentation to the middle of the last frame before
    the light moves, and of the first one after which it stays settled; NaN where it never does within what
    was looked at.
    """

    overdrive: FaultCheck
    began_s: float
    settled_s: float

    @property
    def stands_s(self) -> float:
        """From presentation until 1e-4 of the step is left, twice as long as until 1 % once it moves."""
        return 2.0 * self.settled_s - self.began_s


def step_response(times_s: Float, share: Float, words: str) -> StepResponse:
    """Overdrive and settling from frames that follow a step, many repeats at different phases together.

    times_s: (n,) from presentation to mid-exposure. share: (n, regions) light, 0 before the step, 1 long
    after it. words: the step, e.g. "from code 64 to 192". Regions are judged by themselves: rows of the LCD
    change one after another.
    """
    order = np.argsort(times_s)
    times, light = times_s[order], share[order]
    tail = light[2 * len(times) // 3 :]
    # by neighbours in time, as a light that goes on changing is no noise
    sigma = float(np.median(np.diff(tail, axis=0).std(axis=0, ddof=1))) / math.sqrt(2.0)
    overshoot = float(np.median((light - np.median(tail, axis=0)).max(axis=0)))
    # by chance the largest of n lies so far out
    chance = sigma * math.sqrt(2 * math.log(max(len(times), 2)))
    size = overshoot if overshoot > 1.5 * chance else 0.0
    least = max(SETTLED_SHARE, 2 * chance)
    moved = np.flatnonzero(np.abs(light).max(axis=1) > least)
    began = float(times[moved[0] - 1]) if len(moved) and moved[0] > 0 else 0.0
    late = np.abs(light - np.median(tail, axis=0)).max(axis=1) > least
    last = int(np.max(np.flatnonzero(late), initial=-1))
    settled = float(times[last + 1]) if last + 1 < len(times) - len(tail) // 2 else math.nan
    finding = FaultCheck(
        Fault.OVERDRIVE,
        size,
        sigma,
        f"{words} the light goes past where it settles by {100 * size:.1f} % of the step",
    )
    return StepResponse(finding, min(began, settled), settled)
