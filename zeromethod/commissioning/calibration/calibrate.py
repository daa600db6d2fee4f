"""A whole calibration in one call: open the bench, record it, evaluate what was recorded."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path

from zeromethod.commissioning.calibration.evaluation import Calibration, evaluate_or_keep
from zeromethod.commissioning.calibration.plan import Known, Plan
from zeromethod.commissioning.calibration.procedure import record
from zeromethod.commissioning.calibration.prompts import Prompts
from zeromethod.devices.opening import Devices, open_devices
from zeromethod.optics import check_geometry
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig


def calibrate(
    rig: Rig | str | Path,
    devices: Devices | None = None,
    *,
    press_depths_mm: Sequence[float] = (),
    press_sigma_mm: float = Plan.press_sigma_mm,
    ball_mm: tuple[float, float] | None = None,
    known: Sequence[Known] = (),
    edges: bool = True,
    light: bool = True,
    delay: bool = True,
    rest_frames: int = Plan.rest_frames,
    press_frames: int = Plan.press_frames,
    patience_s: float = Plan.patience_s,
    prompts: Prompts | None = None,
) -> Calibration:
    """Calibrate a bench: response, rest map, delay and geometry, with the error of depth that remains.

    To be called in the main thread, as windows must be. Nothing may touch the mirror before a press is asked
    for, in words, by `prompts`. `store_calibration` writes the result to disk.

    Parameters
    ----------
    rig : Rig, str or Path
        What is believed of the bench: a rig, a rig file, or the name of a packaged rig.
    devices : Devices, optional
        Opened devices, which stay the caller's; by default those of the rig are opened and closed.
    press_depths_mm : sequence of float
        Depths of the presses that will be made, in order.
    press_sigma_mm : float
        How well each depth is known.
    ball_mm : (float, float), optional
        Radius of a ball that is pressed in after the others, and its sigma.
    known : sequence of Direct, MirrorEdge or Intrinsics
        What was measured by hand, observed of the mirror's edges, or found of the camera by itself.
    edges : bool
        Look for the mirror's edges in the pictures.
    light, delay : bool
        Measure the response of camera and LCD, and the delay of both.
    rest_frames, press_frames : int
        Camera frames averaged for each picture of the rest map, and for each press.
    patience_s : float
        Longest wait for a press.
    prompts : Prompts, optional
        Takes what the person at the bench should do, by `say(words)`, and progress, by `part(words, total)`,
        a context manager that gives what is called after each step. By default nobody is informed.

    Returns
    -------
    Calibration
        Its `rig` is the calibrated one, `verdict` says whether to trust it.

    Raises
    ------
    InputError
        For a rig or numbers that cannot be used, and devices that cannot be opened.
    MeasurementError
        A step failed, or a device was lost.
    """
    plan = Plan(
        press_depths_mm=tuple(press_depths_mm),
        press_sigma_mm=press_sigma_mm,
        known=tuple(known),
        light=light,
        delay=delay,
        rest_frames=rest_frames,
        press_frames=press_frames,
        patience_s=patience_s,
        ball_mm=ball_mm,
        edges=edges,
    )
    bench = rig if isinstance(rig, Rig) else load_rig(rig)
    if devices is None and not plan.presses:
        bench = bench.model_copy(update={"scenario": "none"})
    check_geometry(bench)
    with open_devices(bench) if devices is None else nullcontext(devices) as opened:
        recorded, found = record(bench, opened, plan, prompts)
    return evaluate_or_keep(recorded, found, prompts=prompts)
