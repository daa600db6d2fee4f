"""Presses of known depth, read by the loop itself: wait, hold still, take, lift."""

from __future__ import annotations

import enum
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float
from zeromethod.commissioning.calibration.prompts import Prompts, Silent
from zeromethod.devices.opening import Devices
from zeromethod.errors import MeasurementError
from zeromethod.loop.loop import Loop
from zeromethod.loop.state import NULLED, State
from zeromethod.loop.step import Step
from zeromethod.rig.model import Rig
from zeromethod.warp.mean import mean_warp
from zeromethod.warp.warp import Warp

PRESSED_LCD_PX, LIFTED_LCD_PX = 0.8, 0.4
"""Displacement (upper percent of the nodes) from which something presses, and below which it is gone."""

STILL_LCD_PX, STILL_SHARE = 0.05, 0.002
"""Change between the halves of the frames taken, rms over the pressed nodes, up to which a press is
still: the larger of a constant and a share of the displacement."""

DEFAULT_FRAMES = 16
DEFAULT_PATIENCE_S = 300.0
_UPPER_PERCENT = 99.0
_PRESSED_SHARE = 0.3


class Awaited(enum.Enum):
    """What is waited for."""

    REST = "resting"
    COMING = "waiting for the press"
    SETTLING = "pressed, waiting for it to keep still"
    LIFTING = "taken, waiting for the lift"


@dataclass(frozen=True, eq=False)
class PressWarps:
    """Mean warps by the loop.

    rest: of the untouched mirror. pressed: of the presses of known depth, in order. ball: of the ball.
    """

    rest: Warp
    pressed: tuple[Warp, ...]
    ball: Warp | None = None

    @classmethod
    def of(cls, rest: Warp, taken: Sequence[Warp], depths: int) -> PressWarps:
        """From the presses taken: `depths` of known depth, then the ball."""
        return cls(rest, tuple(taken[:depths]), taken[depths] if len(taken) > depths else None)


class PressesEndedError(MeasurementError):
    """Not all presses came; the message says why.

    warps: what was taken before, None where not even the mirror at rest was. interrupted: by Ctrl-C. failed:
    because a device did, which says nothing about the mirror.
    """

    def __init__(self, message: str, *, interrupted: bool = False, failed: bool = False) -> None:
        super().__init__(message)
        self.warps: PressWarps | None = None
        self.interrupted, self.failed = interrupted, failed


class PressWatch:
    """Follows measured warps and takes means of the untouched mirror, then of each press.

    Feed it every step (`take`); a step in which the loop was not nulled is None and breaks the row of frames.
    """

    def __init__(self, frames: int = DEFAULT_FRAMES) -> None:
        """frames: how many make a mean."""
        self.frames = frames
        self._row: deque[Warp] = deque(maxlen=frames)
        self.phase = Awaited.REST
        self.rest: Warp | None = None
        self.pressed: list[Warp] = []

    def take(self, measured: Warp | None) -> bool:
        """Take in one step; whether the phase changed."""
        before = self.phase
        if measured is None:
            self._row.clear()
            return False
        self._row.append(measured)
        match self.phase:
            case Awaited.REST:
                if len(self._row) == self.frames and self._still(0.0, None):
                    self.rest = mean_warp(self._row)
                    self._go(Awaited.COMING)
            case Awaited.COMING:
                if self._strength(measured)[0] > PRESSED_LCD_PX:
                    self._go(Awaited.SETTLING)
            case Awaited.SETTLING:
                strength, away = self._strength(measured)
                if strength < LIFTED_LCD_PX:
                    self._go(Awaited.COMING)
                elif len(self._row) == self.frames and self._still(strength, away):
                    self.pressed.append(mean_warp(self._row))
                    self._go(Awaited.LIFTING)
            case Awaited.LIFTING:
                if self._strength(measured)[0] < LIFTED_LCD_PX:
                    self._go(Awaited.COMING)
        return self.phase is not before

    def _go(self, phase: Awaited) -> None:
        self.phase = phase
        self._row.clear()

    def _strength(self, measured: Warp) -> tuple[float, Float]:
        """Displacement of the upper percent, LCD px, and that of every node, NaN where not known."""
        assert self.rest is not None
        known = measured.valid & self.rest.valid
        away = np.where(known, np.linalg.norm(measured.q - self.rest.q, axis=-1), np.nan)
        return (float(np.nanpercentile(away, _UPPER_PERCENT)) if known.any() else 0.0), away

    def _still(self, strength: float, away: Float | None) -> bool:
        valid = np.logical_and.reduce([warp.valid for warp in self._row])
        if away is not None:
            with np.errstate(invalid="ignore"):
                valid &= away > _PRESSED_SHARE * strength
        if not valid.any():
            return False
        half = self.frames // 2
        q = np.stack([warp.q[valid] for warp in self._row])
        change = q[half:].mean(axis=0) - q[:half].mean(axis=0)
        noise2 = float(np.mean([np.mean(warp.sigma[valid] ** 2) for warp in self._row])) * 4.0 / self.frames
        moved = float(np.sqrt(max(np.mean(change**2) - noise2, 0.0)))
        return moved <= max(STILL_LCD_PX, STILL_SHARE * strength)


def record_presses(
    rig: Rig,
    devices: Devices,
    depths_mm: Sequence[float],
    frames: int = DEFAULT_FRAMES,
    patience_s: float = DEFAULT_PATIENCE_S,
    prompts: Prompts | None = None,
    *,
    ball_radius_mm: float | None = None,
    on_step: Callable[[Step], object] = lambda _step: None,
) -> PressWarps:
    """Close the loop over a rig that fits the bench, and take presses in the order of their depths.

    depths_mm: empty to take the mirror at rest alone. patience_s: of the run's clock, for each change that
    is waited for. ball_radius_mm: of a ball that is asked for last. on_step: called with every step.

    Raises
    ------
    PressesEndedError
        Nothing pressed in time, the press did not keep still or lift, the loop ended, or Ctrl-C.
    """
    watch = PressWatch(frames)
    asked = [f"press {depth:g} mm deep" for depth in depths_mm]
    if ball_radius_mm is not None:
        asked.append(f"press the ball of {ball_radius_mm:g} mm radius in")
    try:
        rest = _follow(rig, devices, asked, patience_s, prompts or Silent(), watch, on_step)
    except (KeyboardInterrupt, PressesEndedError) as error:
        ended = (
            error
            if isinstance(error, PressesEndedError)
            else PressesEndedError("presses: interrupted", interrupted=True)
        )
        if watch.rest is not None:
            ended.warps = PressWarps.of(watch.rest, watch.pressed, len(depths_mm))
        raise ended from None
    return PressWarps.of(rest, watch.pressed, len(depths_mm))


def _follow(
    rig: Rig,
    devices: Devices,
    asked: Sequence[str],
    patience_s: float,
    prompts: Prompts,
    watch: PressWatch,
    on_step: Callable[[Step], object],
) -> Warp:
    """Run the loop until all presses were taken; the mean warp at rest. Raises PressesEndedError."""
    last_ns, hold_s = devices.clock.now_ns(), watch.frames / rig.camera.rate_hz
    loop = Loop(
        rig,
        devices.camera,
        devices.display,
        devices.clock,
        reopen_camera=devices.reopen_camera,
        watches_bench=False,
    )
    with (
        loop,
        closing(loop.run()) as steps,
        prompts.part("rest and presses, by the loop", 1 + len(asked)) as advance,
    ):
        for step in steps:
            on_step(step)
            before = watch.phase
            # a frame that could not be used says nothing about the mirror
            usable = step.state is not State.HOLDING
            if usable and watch.take(step.measured if step.state in NULLED else None):
                last_ns = devices.clock.now_ns()
                if watch.phase is Awaited.LIFTING or (watch.phase is Awaited.COMING and not watch.pressed):
                    advance()
                if watch.phase is Awaited.COMING and len(watch.pressed) == len(asked):
                    assert watch.rest is not None
                    return watch.rest
                _ask(prompts, watch, asked, hold_s, early=before is Awaited.SETTLING)
            elif devices.clock.now_ns() - last_ns > 1e9 * patience_s:
                failed = step.state in {State.FAULT, State.HOLDING, State.STARTING}
                raise PressesEndedError(_missing(watch, len(asked), patience_s, step), failed=failed)
    ended = loop.ended.reason if loop.ended is not None else "it ended"
    raise PressesEndedError(f"presses: the loop did not go on: {ended}", failed=True)


def _ask(prompts: Prompts, watch: PressWatch, asked: Sequence[str], hold_s: float, *, early: bool) -> None:
    """Say what to do next; early: the press was lifted before it could be taken."""
    done, count = len(watch.pressed), len(asked)
    if watch.phase is Awaited.COMING:
        when = "again, it lifted too soon" if early else "now"
        prompts.say(f"press {done + 1} of {count}: {asked[done]} {when}, and hold still for {hold_s:.1f} s")
    elif watch.phase is Awaited.LIFTING:
        prompts.say(f"press {done} of {count}: taken; lift")


def _missing(watch: PressWatch, count: int, patience_s: float, step: Step) -> str:
    what = {
        Awaited.REST: "the loop did not null the mirror at rest",
        Awaited.COMING: f"no press {len(watch.pressed) + 1} of {count}",
        Awaited.SETTLING: "the press did not keep still while the loop was locked",
        Awaited.LIFTING: "the press did not lift",
    }[watch.phase]
    why = "" if step.state in NULLED else f" ({step.state}: {step.reason})"
    return f"presses: {what} within {patience_s:g} s{why}"
