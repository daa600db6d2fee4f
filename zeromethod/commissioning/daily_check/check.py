"""The check itself, on an open bench: light, delay, rest, frames, and a press where one is known."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

import numpy as np

from zeromethod.commissioning.calibration.presses import PressesEndedError, PressWarps, record_presses
from zeromethod.commissioning.calibration.prompts import Prompts, Silent
from zeromethod.commissioning.daily_check.findings import DailyCheck, Finding, Fitness, Subject
from zeromethod.commissioning.daily_check.rest import judge_rest
from zeromethod.commissioning.delay import UnsteadyDelayError, measure_delay
from zeromethod.commissioning.setting_up import SettingUp, Sight
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import CameraLost, DisplayLost
from zeromethod.errors import MeasurementError
from zeromethod.loop.step import Step
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig, check_rig
from zeromethod.surface import SurfaceReader, peak
from zeromethod.warp.rest import Rest

LOOK_S, DELAY_S = 1.0, 3.0
REST_FRAMES = 64
PATIENCE_S = 60.0
"""Longest wait for the rest to be nulled, and for a press."""

LATE_REFRESHES = 0.1
"""Change of the delay, beyond its noise, that is one: the tenth of a refresh to which it can be known."""

MOST_DROPPED = 0.02
"""Share of frames that may be lost."""

SIGMAS = 3.0


@dataclass
class _Frames:
    """Counts of the loop's frames."""

    came: int = 0
    dropped: int = 0
    refused: dict[str, int] = field(default_factory=dict)

    def note(self, step: Step) -> None:
        if step.frame_number is None:
            return
        if not self.came and step.measured is None:
            return  # the first picture is not lit yet; what was lost before it is nobody's loss
        self.dropped += step.dropped if self.came else 0
        self.came += 1
        if step.measured is None:
            self.refused[step.reason] = self.refused.get(step.reason, 0) + 1


def check_bench(
    rig: Rig,
    devices: Devices,
    *,
    press_depth_mm: float | None = None,
    press_sigma_mm: float = 1e-3,
    warning: str | None = None,
    prompts: Prompts | None = None,
) -> DailyCheck:
    """Find out whether a bench is still the one that was calibrated, in about two minutes.

    To be called in the main thread, as windows must be. Nothing may touch the mirror before a press is asked
    for, in words, by `prompts`.

    Parameters
    ----------
    rig : Rig
        The calibrated rig.
    devices : Devices
        Its opened devices.
    press_depth_mm : float, optional
        Depth of the press that will be made; by default none is asked for.
    press_sigma_mm : float
        How well that depth is known.
    warning : str, optional
        What is wrong with the calibration itself, such as its age.
    prompts : Prompts, optional
        Takes what the person at the bench should do, by `say(words)`, and progress, by `part(words, total)`,
        a context manager that gives what is called after each step. By default nobody is informed.

    Returns
    -------
    DailyCheck
        What was found; `fitness` says what may be done with the bench.

    Raises
    ------
    MeasurementError
        A device was lost.
    """
    check_rig("check_bench", rig)
    return _Check(rig, devices, prompts or Silent()).run(press_depth_mm, press_sigma_mm, warning)


class _Check:
    def __init__(self, rig: Rig, devices: Devices, prompts: Prompts) -> None:
        self._rig, self._devices, self._prompts = rig, devices, prompts

    def run(self, depth_mm: float | None, sigma_mm: float, warning: str | None) -> DailyCheck:
        findings = [Finding(Subject.CALIBRATION, Fitness.DRIFTED, warning)] if warning else []
        self._prompts.say("do not touch the mirror" + (" before you are asked to" if depth_mm else ""))
        try:
            findings.append(self._light())
            findings.append(self._delay())
            findings += self._loop(depth_mm, sigma_mm)
        except CameraLost as error:
            raise MeasurementError(f"check: the camera is lost: {error}") from error
        except DisplayLost as error:
            raise MeasurementError(f"check: the display is lost: {error}") from error
        return DailyCheck(self._rig.name, tuple(findings))

    def _light(self) -> Finding:
        last: Sight | None = None
        with self._bar("light and focus", LOOK_S) as advance:
            for sight in SettingUp(self._rig, self._devices, with_lcd=True).sights(LOOK_S):
                last = sight
                advance()
        if last is None:
            raise MeasurementError("check: the camera gave no frame")
        report = last.report
        figures = {
            "focus_score": report.score,
            "saturated_share": report.saturated_share,
            "usable_share": report.usable_share,
            "flicker_share": last.flicker_share,
        }
        if last.advice:
            return Finding(Subject.LIGHT, Fitness.UNFIT, "; ".join(last.advice), figures)
        words = f"focus {report.score:.2f}, {report.usable_share:.1%} of the view usable"
        return Finding(Subject.LIGHT, Fitness.GOOD, words, figures)

    def _delay(self) -> Finding:
        rig = self._rig
        try:
            with self._bar("delay", DELAY_S) as advance:
                found = measure_delay(rig, self._devices, DELAY_S, advance)
        except UnsteadyDelayError as error:
            why = str(error).removeprefix("delay: ")
            return self._unsteady(f"no one value stands for it: {why}", error.scatter_s, {})
        except MeasurementError as error:
            return Finding(Subject.DELAY, Fitness.UNFIT, str(error).removeprefix("delay: "))
        change_s = found.latency_s - rig.display.latency_s
        figures = {"delay_ms": 1e3 * found.latency_s, "delay_change_ms": 1e3 * change_s}
        measured = f"{1e3 * found.latency_s:.2f} ± {1e3 * found.sigma_s:.2f} ms"
        words = f"{measured}, {1e3 * change_s:+z.2f} ms from the rig file's"
        fits = abs(change_s) <= SIGMAS * found.sigma_s + LATE_REFRESHES / rig.display.refresh_hz
        if found.scatter_s is not None and fits:
            return self._unsteady(f"{words}: {found.why}", found.scatter_s, figures)
        if fits:
            return Finding(Subject.DELAY, Fitness.GOOD, words, figures)
        words += ": readings of a mirror that moves are late or early by that: devices --delay --write"
        return Finding(Subject.DELAY, Fitness.DRIFTED, words, figures)

    def _unsteady(self, words: str, scatter_s: float, figures: dict[str, float]) -> Finding:
        """A delay that changes from frame to frame, by what that means for depth.

        Coded strips time every frame of a run by itself, and what they cannot time is not read (`_frames`
        counts it): at rest depth is as good as ever, moving it is off by speed times scatter.
        """
        figures = figures | {"delay_scatter_ms": 1e3 * scatter_s}
        moving = f"a mirror that moves by 1 mm/s is read up to {1e3 * scatter_s:.0f} µm off in depth"
        if self._rig.coded:
            words += f"; coded strips time every frame, depth at rest is as good as ever; {moving}"
            return Finding(Subject.DELAY, Fitness.GOOD, words, figures)
        words += (
            f"; without coded strips pictures are confused: `run --strips`, or end other programs; {moving}"
        )
        return Finding(Subject.DELAY, Fitness.DRIFTED, words, figures)

    def _loop(self, depth_mm: float | None, sigma_mm: float) -> list[Finding]:
        """What the closed loop sees: the rest, its frames, and the press."""
        frames, rig = _Frames(), self._rig
        depths = () if depth_mm is None else (depth_mm,)
        missing = ""
        try:
            warps = record_presses(
                *(rig, self._devices, depths, REST_FRAMES, PATIENCE_S, self._prompts), on_step=frames.note
            )
        except PressesEndedError as error:
            if error.interrupted:
                raise KeyboardInterrupt from None
            missing = str(error).removeprefix("presses: ")
            if error.warps is None:
                fitness = Fitness.UNFIT if error.failed else Fitness.RECALIBRATE
                return [Finding(Subject.REST, fitness, missing), self._frames(frames)]
            warps = error.warps
        optics = Optics(rig)
        rest = Rest.of(rig, optics)
        reader = SurfaceReader(rig, optics, rest.grid)
        found = [judge_rest(optics, rest, reader, warps.rest), self._frames(frames)]
        if missing:
            found.append(Finding(Subject.PRESS, Fitness.UNFIT, missing))
        elif depth_mm is not None:
            found.append(_press(reader, rest, warps, depth_mm, sigma_mm))
        return found

    def _frames(self, frames: _Frames) -> Finding:
        if not frames.came:
            return Finding(Subject.FRAMES, Fitness.UNFIT, "none came: see to camera and cable")
        share = frames.dropped / (frames.came + frames.dropped)
        unused = sum(frames.refused.values())
        figures = {"frames": float(frames.came), "dropped": float(frames.dropped), "unused": float(unused)}
        words = f"{frames.came} came, {frames.dropped} were lost, {unused} could not be used"
        if frames.refused:
            words += f" (most: {max(frames.refused, key=lambda reason: frames.refused[reason])})"
        if share <= MOST_DROPPED and unused <= MOST_DROPPED * frames.came + 1:
            return Finding(Subject.FRAMES, Fitness.GOOD, words, figures)
        words += ": end other programs, or see `devices --speed`"
        return Finding(Subject.FRAMES, Fitness.DRIFTED, words, figures)

    def _bar(self, words: str, seconds: float) -> AbstractContextManager[Callable[[], object]]:
        return self._prompts.part(words, math.ceil(seconds * self._rig.camera.rate_hz))


def _press(reader: SurfaceReader, rest: Rest, warps: PressWarps, depth_mm: float, sigma_mm: float) -> Finding:
    """The press as read from the rest just measured."""
    zero = np.where(warps.rest.valid[..., None], warps.rest.q - rest.q, 0.0)
    read = peak(reader.read(warps.pressed[0].less(zero)))
    error_mm = read.depth_mm - depth_mm
    percent, sigma = 100.0 * error_mm / depth_mm, math.hypot(read.sigma_mm, sigma_mm)
    figures = {
        "press_read_mm": read.depth_mm,
        "press_sigma_mm": sigma,
        "press_error_percent": percent,
    }
    words = (
        f"read {read.depth_mm:.4f} mm of {depth_mm:g} mm: {percent:+z.2f} ± {100.0 * sigma / depth_mm:.2f} %"
    )
    fits = abs(error_mm) <= SIGMAS * sigma
    return Finding(Subject.PRESS, Fitness.GOOD if fits else Fitness.RECALIBRATE, words, figures)
