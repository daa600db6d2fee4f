"""What is measured, part by part: each function's figures are of one seed."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.every_pixel.scenes import (
    OPEN_GAIN,
    PRESS_S,
    EightStepReader,
    FourierReader,
    bench_rig,
    eight_steps,
    held,
    predicted_height,
    seen_peak_mm,
    wave_height,
    waved,
)
from benchmarks.pads import pad as soft
from benchmarks.process_use import memory_mb, spent_ms
from benchmarks.rigs import changed, opened, pressed
from benchmarks.salt import generator
from zeromethod.arrays import Float, Single
from zeromethod.errors import InputError
from zeromethod.fine.frames import FRAMES
from zeromethod.fine.reader import FineReader
from zeromethod.fine.surface import FineSurface
from zeromethod.loop.circle import Circle
from zeromethod.optics import Optics
from zeromethod.rig.load import load_rig
from zeromethod.session.fine import STEP, FineReadings, frame_of, with_moving_target
from zeromethod.session.zero_doubt import ZeroDoubt
from zeromethod.simulation.press import Mirror
from zeromethod.surface import SurfaceReader, peak

Found = dict[str, float]

DENTS = {
    0.3: 1.1e-3, 0.5: 3e-3, 1.0: 12e-3, 1.5: 27e-3,
}  # fmt: skip
"""Sigma in mm: depth in mm, half of that of the fold."""
PADS_MM = (2e-3, 1e-2, 5e-2)
REST_FRAMES = 60
_REST_STEP = REST_FRAMES // 2
"""One turn of the target there and back in those frames: slow steps blur less in mixed exposures."""
_MEAN_FRAMES = 4 * STEP
"""Frames of the long mean that are read together: of two turns there and back of the target, whose steps in
either direction a wrong delay shifts in opposite ones."""
PAD_SIGMA_MM = 5.0
_BLOCK_PX = 8
_DELAY_WRONG_S = 1e-4
_PLACES = 100
"""Places of an untouched mirror at which a press is looked for, each seed."""


def dent(sigma_mm: float, seed: int) -> Found:
    """Errors of a narrow dent's peak, percent."""
    depth_mm, errors = DENTS[sigma_mm], {}
    for gain in (1.0, OPEN_GAIN):
        path = [(PRESS_S, 0.0), (PRESS_S, depth_mm)]
        with pressed(bench_rig(seed, gain=gain), path, sigma_mm) as narrow:
            one = held(narrow)
            stepped = partial(EightStepReader, [] if gain == 1.0 else eight_steps(narrow))
        divided = 100 * (one.read().peak[0] / depth_mm - 1)
        if gain == 1.0:
            raw = one.read(divide=False)
            errors["divided"], errors["raw"] = divided, 100 * (raw.peak[0] / depth_mm - 1)
            errors["seen"] = 100 * (raw.peak[0] / seen_peak_mm(one, raw) - 1)
        else:
            errors["open"] = divided
            errors["Fourier"] = 100 * (one.read(FourierReader).peak[0] / depth_mm - 1)
            errors["eight steps"] = 100 * (one.read(stepped).peak[0] / depth_mm - 1)
    return errors


def wave(along_x: bool, wave_mm: float, seed: int) -> Found:
    """Height of a wave, and what footprint, lens and pixel leave of it."""
    with waved(bench_rig(seed), along_x, wave_mm) as rig:
        one = held(rig)
    predicted = predicted_height(one.rig, one.optics, along_x, wave_mm)
    return {"height": wave_height(one, along_x, wave_mm), "predicted": predicted}


def half_response_mm(along_x: bool) -> float:
    """Pitch of the wave of which pupil, lens and pixel leave half."""
    rig = bench_rig(0)
    optics, shortest, longest = Optics(rig), 0.05, 2.0
    while longest / shortest > 1.0001:
        middle = (shortest * longest) ** 0.5
        enough = predicted_height(rig, optics, along_x, middle) > 0.5
        shortest, longest = (shortest, middle) if enough else (middle, longest)
    return longest


def rest(seed: int) -> Found:
    """Depth of the whole view untouched, nm rms, and the largest press that is found in it, in sigmas."""
    rig = bench_rig(seed, view=None, step=_REST_STEP).model_copy(update={"scenario": "none"})
    surface = held(rig, REST_FRAMES).read(divide=False)
    coarse, rng = surface.coarse, generator(seed)
    places = np.stack([rng.uniform(20.0, 62.0, _PLACES), rng.uniform(-8.0, 8.0, _PLACES)], axis=-1)
    fields = (
        coarse.depth_mm[coarse.valid],
        surface.depth_mm[surface.valid],
        surface.sigma_depth_mm[surface.valid],
    )
    nodes, pixels, stated = (1e6 * float(np.sqrt(np.mean(one.astype(float) ** 2))) for one in fields)
    found = max(abs(pressed_sigmas(surface, x, y)) for x, y in places)
    valid = float(np.mean(surface.valid))
    return {"nodes": nodes, "pixels": pixels, "stated": stated, "found": found, "valid": valid}


def tiny_press(seed: int) -> Found:
    """Sigmas at which a press of 5 nm, 8 nm where the lever is shorter, is found where it is."""
    rng = generator(seed)
    x, y = float(rng.uniform(20.0, 62.0)), float(rng.uniform(-8.0, 8.0))
    depth_mm = 5e-6 if x >= 30.0 else 8e-6
    path = [(PRESS_S, 0.0), (PRESS_S, depth_mm)]
    with pressed(bench_rig(seed, view=None), path, PAD_SIGMA_MM, (x, y)) as rig:
        surface = held(rig, REST_FRAMES).read(divide=False)
    return {"sigmas": pressed_sigmas(surface, x, y), "x_mm": x}


def pressed_sigmas(surface: FineSurface, x_mm: float, y_mm: float) -> float:
    """Depth of a pad at a place by the matched filter of its slopes, over its standard deviation.

    Slopes of pixels are independent; a tilt of the whole view is left open.
    """
    rows, cols = (n // _BLOCK_PX * _BLOCK_PX for n in surface.valid.shape)

    def mean(field: Single) -> Float:
        cut = (
            field[:rows, :cols]
            .astype(float)
            .reshape(rows // _BLOCK_PX, _BLOCK_PX, cols // _BLOCK_PX, _BLOCK_PX)
        )
        return np.asarray(cut.mean(axis=(1, 3)))

    by_x, by_y = Mirror((soft(x_mm, y_mm, 1.0, PAD_SIGMA_MM),)).slope(mean(surface.x_mm), mean(surface.y_mm))
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for axis, shape in enumerate((by_x, by_y)):
        slope, variance = (
            mean(surface.slope[..., axis]),
            mean(surface.sigma_slope[..., axis] ** 2) / _BLOCK_PX**2,
        )
        known = np.isfinite(slope + variance)
        terms = np.zeros((np.count_nonzero(known), 3))
        terms[:, 0], terms[:, 1 + axis] = shape[known], 1.0
        weighted = terms / variance[known][:, None]
        normal += weighted.T @ terms
        right += weighted.T @ slope[known]
    covariance = np.linalg.inv(normal)
    return float((covariance @ right)[0] / np.sqrt(covariance[0, 0]))


def pad(depth_mm: float, seed: int) -> Found:
    """Errors of a pad's peak, percent: of the null, of an open loop that steps, and of one frame of it."""
    errors = {}
    for gain in (1.0, OPEN_GAIN):
        rig = bench_rig(seed, view=None, binning=2, gain=gain)
        with pressed(rig, [(PRESS_S, 0.0), (PRESS_S, depth_mm)], PAD_SIGMA_MM) as wide:
            one = held(wide)
            stepped = partial(EightStepReader, [] if gain == 1.0 else eight_steps(wide))
        error = 100 * (one.read(divide=False).peak[0] / depth_mm - 1)
        errors["null" if gain == 1.0 else "open, stepping"] = error
        if gain != 1.0:
            fourier = one.read(FourierReader, divide=False)
            errors["Fourier"] = 100 * (fourier.peak[0] / depth_mm - 1)
            eight = one.read(stepped, divide=False)
            errors["eight steps"] = 100 * (eight.peak[0] / depth_mm - 1)
            single = SurfaceReader(one.rig, one.optics, one.grid).read(one.frames[-1].measured)
            errors["open, one frame"] = 100 * (peak(single).depth_mm / depth_mm - 1)
    return errors


def long_mean(frames: int, binning: int) -> Found:
    """Rms of the mean depth of many frames at rest, nm, plane included.

    The clocks jitter by 0.1 ms, the delay is 0.1 ms more than the rig file says, and the chip has a fixed
    pattern of 1 % and 1 grey level.
    """
    rig = bench_rig(0, view=None, binning=binning).model_copy(update={"scenario": "none"})
    nuisances = {"pixel_gain": 0.01, "pixel_offset_grey": 1.0}
    true = changed(
        rig, simulation={"nuisances": nuisances, "camera_jitter_s": 1e-4, "display_jitter_s": 1e-4}
    )
    true = changed(true, display={"latency_s": rig.display.latency_s + _DELAY_WRONG_S})
    total: dict[str, Float] = {}
    kept, count = [], 0
    with opened(rig, true) as bench:
        reader = FineReader(rig, bench.optics, bench.loop.grid, divide=False)
        for number, step in enumerate(bench.loop.run(frames=FRAMES + frames + 4)):
            frame = frame_of(step)
            if frame is None or number < FRAMES:
                continue
            kept.append(frame)
            if len(kept) < _MEAN_FRAMES:
                continue
            try:
                surface = reader.read(kept)
            except InputError:  # frames whose phases do not determine a pixel
                continue
            finally:
                kept.clear()
            count += 1
            for name, depth in (("nodes", surface.coarse.depth_mm), ("pixels", surface.depth_mm)):
                total[name] = total.get(name, 0.0) + depth.astype(float)
    rms = {name: 1e6 * float(np.sqrt(np.nanmean((one / count) ** 2))) for name, one in total.items()}
    return {**rms, "frames": float(count * _MEAN_FRAMES)}


def loop_cost(frames: int) -> Found:
    """Median processor time of the loop, ms: target at rest, moving, and moving with surfaces read alongside.

    Frame by frame in turn. And a reading's processor time, ms, the most memory its process holds, MB.
    """
    rig = load_rig("simulated").model_copy(update={"scenario": "none"})
    names = "still", "step", "fine"
    with ExitStack() as stack:
        benches = {name: stack.enter_context(opened(rig if name == "still" else with_moving_target(rig)))
                   for name in names}  # fmt: skip
        times_ms = stack.enter_context(timed())
        one = benches["fine"]
        readings = FineReadings(
            one.rig, one.optics, one.loop.grid, one.truth, ZeroDoubt(one.rig, one.loop.rest)
        )
        stack.enter_context(readings.in_own_process())
        process, memory, spent = readings.process_id or 0, [0.0], [0.0]
        runs = [bench.loop.run(frames=frames) for bench in benches.values()]
        for *_, step in zip(*runs, strict=True):
            readings.add(step)
            memory.append(memory_mb(process))
            if readings.collect():
                spent.append(spent_ms({"fine": process})["fine"])
    medians = {
        name: float(np.median(values[frames // 4 :]))
        for name, values in zip(names, times_ms.values(), strict=True)
    }
    # the first one compiles, or loads what was
    return medians | {"memory_mb": max(memory), "reading_ms": float(np.median(np.diff(spent)[1:]))}


@contextmanager
def timed() -> Iterator[dict[int, list[float]]]:
    """Within this context, the thread's processor time for each frame from hand to command, ms, by circle."""
    take: Callable[..., Any] = Circle.take
    times_ms: dict[int, list[float]] = {}

    def measured(circle: Circle, *args: Any) -> Any:
        begun_ns = time.thread_time_ns()
        result = take(circle, *args)
        times_ms.setdefault(id(circle), []).append(1e-6 * (time.thread_time_ns() - begun_ns))
        return result

    with patch.object(Circle, "take", measured):
        yield times_ms
