"""The zero: taking the mirror as it is now for the mirror at rest, against slow drift of LCD or prism.

The zero enters the reading by subtraction: of the warp at rest as measured from that by the rig's geometry,
LCD px, node by node. For an LCD that slid in its mount, the largest part of drift, that is exact, as every
ray then meets a point so many pixels further on; it leaves the camera's rays as calibrated, of which drift of
the LCD says nothing. (`zeromethod.surface.RestGrid` blames the camera's rays instead: for calibration.) What
it does to depth as an error of the rig file goes into sigma (`zeromethod.calibration.left_open`).

Not everything may be called zero. Drift is smooth over the view, small and slow: a quadratic form in camera
px fits it. What a press does is not, unless it is far wider than the view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float, Mask
from zeromethod.loop.events import Event, Notice
from zeromethod.loop.rest_memory import RestMemory, quadratic
from zeromethod.loop.state import LOCK_RESIDUAL_PX
from zeromethod.warp.rest import Rest
from zeromethod.warp.warp import Warp

NO_ZERO = "no new zero"
"""What a refusal begins with."""

FRAMES = 8
"""Good frames whose mean warp is the zero."""

PATIENCE_FRAMES = 60
"""Frames after which too few good ones mean that there is none to be had."""

LIFT = "Lift it; if it is dirt that came since, start again"
"""What to do about a press that was not there at the first rest."""

BLOCK = 8
"""Nodes on a side of the blocks over which noise is averaged."""

LARGEST_LCD_PX = 3.0
"""Drift of more than this anywhere is no drift."""

WITHIN_LCD_PX = 0.05
"""Rms of a block, beyond three deviations of noise, by which drift may miss the fit: 0.2 µm of press."""

STEADY_LCD_PX = 0.1
"""Rms of a block, beyond three deviations of noise, between the earlier and the later half of the frames."""


def _quadratic(rest: Rest) -> Float:
    """(rows, cols, 6) terms up to second order of the nodes' places, of size 1."""
    u, v = rest.grid.mesh()
    return quadratic((u - u.mean()) / np.ptp(u), (v - v.mean()) / np.ptp(v))


def _worst_block(values: Float, used: Mask) -> float:
    """Largest rms of any block, per component; values (rows, cols, 2), 0 where not used."""
    rows, cols = (-(-size // BLOCK) * BLOCK for size in used.shape)
    padding = (0, rows - used.shape[0]), (0, cols - used.shape[1])
    square = np.pad(np.where(used, 0.5 * np.sum(values**2, axis=-1), 0.0), padding)
    count = np.pad(used.astype(np.float64), padding)
    shape = rows // BLOCK, BLOCK, cols // BLOCK, BLOCK
    squares, counts = (one.reshape(shape).sum(axis=(1, 3)) for one in (square, count))
    return float(np.sqrt(np.max(squares / np.maximum(counts, BLOCK))))


@dataclass(frozen=True)
class NoZero:
    """Why no zero could be taken."""

    reason: str


class ZeroTaking:
    """Gathers frames until a zero can be taken or refused.

    rest_q: (rows, cols, 2) LCD px, the warp of the untouched mirror until now. memory: what was off there.
    """

    def __init__(self, rest: Rest, rest_q: Float, memory: RestMemory) -> None:
        self._rest = rest
        self._rest_q = rest_q
        self._memory = memory
        self._measured: list[Warp] = []
        self._frames = 0

    def take(self, measured: Warp | None, residual_rms_px: float) -> Float | NoZero | None:
        """Take in a frame, with no measurement where it was not usable.

        Returns the zero, (rows, cols, 2) LCD px to add to the warp at rest; why there is none; or None as
        long as frames are still needed.
        """
        self._frames += 1
        if measured is not None and residual_rms_px < LOCK_RESIDUAL_PX:
            self._measured.append(measured)
        if len(self._measured) == FRAMES:
            return self._judge()
        if self._frames >= PATIENCE_FRAMES:
            return NoZero(f"only {len(self._measured)} of {self._frames} frames were nulled")
        return None

    def _judge(self) -> Float | NoZero:
        rest = self._rest
        away = np.stack([warp.q for warp in self._measured]) - rest.q
        valid = np.stack([warp.valid for warp in self._measured])
        used = valid.all(axis=0) & rest.visible
        if np.count_nonzero(used) < 0.5 * np.count_nonzero(rest.visible):
            return NoZero("too much of the mirror is hidden")
        mean = np.where(used[..., None], away.mean(axis=0), 0.0)
        sigma = np.sqrt(np.mean([warp.sigma**2 for warp in self._measured], axis=0) / FRAMES)
        noise = float(np.sqrt(np.mean(sigma[used] ** 2)))
        half = FRAMES // 2
        moved = np.where(used[..., None], away[half:].mean(axis=0) - away[:half].mean(axis=0), 0.0)
        if _worst_block(moved, used) > 2 * 3 * noise + STEADY_LCD_PX:
            return NoZero("the mirror moves")
        terms = _quadratic(rest)
        fit = terms @ np.linalg.lstsq(terms[used], mean[used], rcond=None)[0]
        since = mean + rest.q - self._rest_q
        new = since - self._memory.off
        misfit = _worst_block(new - terms @ np.linalg.lstsq(terms[used], new[used], rcond=None)[0], used)
        if misfit > 3 * noise + WITHIN_LCD_PX:
            return NoZero(f"something presses: a dent of {misfit:.2f} LCD px is seen")
        if pressed := self._memory.pressed_lcd_px(since, sigma, used):
            return NoZero(f"something presses that did not at the first rest: {pressed:.2f} LCD px. {LIFT}")
        largest = float(np.abs(fit[used]).max())
        if largest > LARGEST_LCD_PX:
            return NoZero(
                f"the picture is {largest:.1f} LCD px away from rest: more than drift ({LARGEST_LCD_PX:g})"
            )
        zero: Float = np.where(used[..., None], mean, fit)
        return zero


class Zero:
    """The zero that all readings start from, taken again on request.

    q: (rows, cols, 2) LCD px, the warp at rest less the rig's; None for 0.
    """

    def __init__(self, rest: Rest) -> None:
        self.q: Float | None = None
        self._rest = rest
        self._memory = RestMemory(rest.grid.shape)
        self._taking: ZeroTaking | None = None

    @property
    def rest_q(self) -> Float:
        """(rows, cols, 2) LCD px, the warp of the untouched mirror."""
        return self._rest.q if self.q is None else self._rest.q + self.q

    def shift(self, q: Float) -> None:
        """Shift the warp of the untouched mirror by (rows, cols, 2) LCD px."""
        self.q = q if self.q is None else self.q + q

    def request(self) -> None:
        """Take the mean warp of the next nulled frames."""
        self._taking = ZeroTaking(self._rest, self.rest_q, self._memory)

    def at_rest(self, estimate: Float, measured: Warp) -> bool:
        """Whether the mirror is untouched, by the controller's estimate (rows, cols, 2) and a frame."""
        return self._memory.at_rest(estimate, measured, self.rest_q)

    def take(self, measured: Warp | None, residual_rms_px: float, resting: bool = False) -> Notice | None:
        """Take in a frame, at rest where `resting`; the notice says how the taking of a zero ended."""
        if resting and measured is not None:
            self._memory.learn(measured, self.rest_q)
        found = None if self._taking is None else self._taking.take(measured, residual_rms_px)
        if found is None:
            return None
        self._taking = None
        if isinstance(found, NoZero):
            return Notice(Event.ZERO_REFUSED, f"{NO_ZERO}: {found.reason}")
        self.q = found
        self._memory.restart()
        drift = float(np.sqrt(np.mean(np.sum(found[self._rest.visible] ** 2, axis=-1))))
        words = (
            f"readings start from here now, {drift:.2f} LCD px (rms) from the rig file's rest: put away as "
            "motion of the LCD; sigma of depth has in it what an error of the rig file so large would do"
        )
        return Notice(Event.ZERO_TAKEN, words)
