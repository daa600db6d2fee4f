"""How time and memory grow with the frame: every method at sizes from 320x256 to 2560x2048.

The frames are one small noisy picture of the target repeated; integrators get as many nodes as this system
has on a frame of that size. "warp to surface and peak" is its whole reading of a held press, on the simulated
bench with more or fewer pixels over the same view. Memory is measured in a process of its own, see `memory`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import cycle
from typing import Any

import numpy as np

from benchmarks.against_peers.frames import PERIOD_PX, SIGMA_GREY, repeated
from benchmarks.against_peers.integration import INTEGRATORS, Task
from benchmarks.against_peers.methods import CONTENDERS, Contender
from benchmarks.anchors import View
from benchmarks.pads import pad
from zeromethod.rig.load import load_rig
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.surface import peak
from zeromethod.warp.grid import NodeGrid

Figures = dict[str, Any]
OnStep = Callable[[str], None]
Size = tuple[int, int]

SIZES: tuple[Size, ...] = ((256, 320), (512, 640), (1024, 1280), (2048, 2560))
"""(rows, cols) of the frames."""

SETTLING = 40
"""Readings before any is timed; the first takes all samples of noise at once."""

NODE_PITCH_MM = 0.24
REPEATED_PX = (256, 320)
MEMORY_TIMEOUT_S = 300.0
MEMORY_ENVIRONMENT = {"MALLOC_MMAP_THRESHOLD_": "65536"}
"""Makes glibc give freed arrays back at once, so that they are seen when they come again."""


def sizes(quick: bool) -> tuple[Size, ...]:
    """Frame sizes that are measured."""
    return SIZES[:2] if quick else SIZES


def steps(quick: bool) -> int:
    """How often `measure` reports a step."""
    return 2 + sum(_rounds(shape) for shape in sizes(quick))


def _rounds(shape: Size) -> int:
    """Rounds at a size, the first of which warms up."""
    return 3 if shape == SIZES[-1] else 5


def frames_of(contender: Contender, shape: Size) -> Any:
    """Frames (shots, rows, cols) uint8 near null for a contender, made without large temporaries."""
    small = np.zeros((*REPEATED_PX, 2))
    return repeated(contender.pattern.frames(small, SIGMA_GREY, np.random.default_rng(0)), shape)


def integration_task(shape: Size) -> Task:
    """Slopes of a press on a regular lattice of the nodes of a frame of that size."""
    grid = NodeGrid(shape, PERIOD_PX)
    u, v = (mesh[grid.inner] for mesh in grid.mesh())
    x, y = (NODE_PITCH_MM / grid.spacing_px * (mesh - mesh.mean()) for mesh in (u, v))
    press = Mirror((Dent(Shape.GAUSSIAN, 0.0, 0.0, 0.2, float(np.ptp(x)) / 7),))
    slope = np.stack(press.slope(x, y), axis=-1)
    return Task(x, y, np.ones(x.shape, bool), slope, press.depth(x, y))


Job = Callable[[], object]


def displacement_job(make: Callable[[Size], Contender], shape: Size) -> tuple[str, Job]:
    """(name, one reading) of a contender."""
    contender = make(shape)
    frames = frames_of(contender, shape)
    return contender.name, lambda: contender.read(frames)


def reading_job(shape: Size) -> Job:
    """One reading of a held press with a frame's noise, each time another's, once sigma is settled."""
    camera = load_rig("simulated").camera
    factor = shape[1] / camera.columns
    scale = {
        "columns": shape[1],
        "rows": shape[0],
        "centre_px": tuple((c + 0.5) * factor - 0.5 for c in camera.centre_px),
        "focal_px": camera.focal_px and tuple(f * factor for f in camera.focal_px),
        "pixel_mm": camera.pixel_mm and camera.pixel_mm / factor,
    }
    view = View(load_rig("simulated").model_copy(update={"camera": camera.model_copy(update=scale)}))
    middle = 0.5 * (view.seen.min(axis=0) + view.seen.max(axis=0))
    press = Mirror((pad(float(middle[0]), float(middle[1]), 0.2, 5.0),))
    draw = np.random.default_rng(0)
    warps = cycle([view.warp(press, draw) for _ in range(2)])

    def read() -> None:
        peak(view.reader.follow(next(warps)))

    for _ in range(SETTLING):
        read()
    return read


def jobs(shape: Size) -> dict[str, Job]:
    """Everything that is timed at one size, by name."""
    all_jobs = dict(displacement_job(make, shape) for make in CONTENDERS.values())
    task = integration_task(shape)
    for name, make in INTEGRATORS.items():
        integrate = make(task)
        all_jobs[name] = lambda integrate=integrate: integrate(task.slope)  # type: ignore[misc]
    all_jobs["warp to surface and peak"] = reading_job(shape)
    return all_jobs


def measure(figures: Figures, on_step: OnStep, quick: bool) -> None:
    """Fill `figures`: "methods" by name with ms and MB by size, and what they grow like."""
    methods: dict[str, Figures] = figures.setdefault("methods", {})
    figures["sizes_px"] = [[cols, rows] for rows, cols in sizes(quick)]
    figures["rounds"] = [_rounds(shape) - 1 for shape in sizes(quick)]
    on_step("scaling")
    for shape in sizes(quick):
        timed = jobs(shape)
        ms: dict[str, list[float]] = {name: [] for name in timed}
        for turn in range(_rounds(shape)):
            for name, job in timed.items():
                started = time.perf_counter()
                job()
                if turn:
                    ms[name].append(1e3 * (time.perf_counter() - started))
            on_step(f"scaling, {shape[1]}x{shape[0]}")
        for name, values in ms.items():
            methods.setdefault(name, {"ms": []})["ms"].append(float(np.median(values)))
        for found in methods.values():
            found.update(_growth(figures["sizes_px"], found["ms"]))
    memory, note = _memory(sizes(quick))
    figures["memory_note"] = note
    for name, found in methods.items():
        found["memory_mb"] = memory.get(name)
    on_step("")


def _growth(sizes_px: list[list[int]], ms: list[float]) -> Figures:
    """Exponent of time over pixels (slope of the log-log line), and ms per megapixel at the largest size."""
    megapixels = np.array([cols * rows for cols, rows in sizes_px[: len(ms)]]) / 1e6
    exponent = float(np.polyfit(np.log(megapixels), np.log(ms), 1)[0]) if len(ms) > 1 else None
    return {"time_exponent": exponent, "ms_per_megapixel": ms[-1] / megapixels[-1]}


def _memory(shapes: tuple[Size, ...]) -> tuple[dict[str, list[float]], str]:
    """(MB per size by method, "" or why there are none)."""
    command = [sys.executable, "-m", "benchmarks.against_peers.memory", json.dumps(shapes)]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            timeout=MEMORY_TIMEOUT_S,
            check=False,
            env=os.environ | MEMORY_ENVIRONMENT,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return {}, f"not measured: {error}"
    if done.returncode:
        last = done.stderr.strip().splitlines()[-1:] or [f"exit code {done.returncode}"]
        return {}, f"not measured: {last[0]}"
    found: dict[str, list[float]] = json.loads(done.stdout)
    return found, ""
