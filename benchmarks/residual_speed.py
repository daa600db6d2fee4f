"""Time of one residual at 1280x1024 beside a plain numpy/BLAS version and OpenCV's DIS optical flow.

Run: `python benchmarks/residual_speed.py`. One thread each, same images, medians of interleaved rounds.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
from numpy.typing import NDArray

from zeromethod.rig.model import Noise
from zeromethod.sensing import ResidualSensor
from zeromethod.sensing.window import triangle
from zeromethod.warp.grid import PADDING, NodeGrid

SHAPE, PERIOD = (1024, 1280), 16
NOISE = Noise(read_grey=2.0, electrons_per_grey=150.0, black_grey=4.0)
ROUNDS = 25


def light(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    carrier = np.cos(2 * np.pi * u / PERIOD) + np.cos(2 * np.pi * v / PERIOD)
    return np.asarray(0.5 * (1 + 0.45 * carrier))


def scene(
    peak_px: float, width_px: float, *, hole: bool = False
) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    bump = np.exp(-((u - 640) ** 2 + (v - 512) ** 2) / (2 * width_px**2))
    du, dv = peak_px * bump, -0.7 * peak_px * bump
    shown = light(u + du, v + dv)
    if hole:
        shown[300:400, 700:800] = 0.0
    grey = 4 + 204 * shown + 2.0 * np.random.default_rng(0).standard_normal(SHAPE)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8), np.stack([du, dv], axis=-1)


def blas_version(grid: NodeGrid) -> Callable[[NDArray[np.uint8]], NDArray[np.float64]]:
    """Build the same windows as two dense matrix products: rows, then columns."""

    def matrix(
        nodes: int, length: int
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        plain = np.zeros((nodes, length), np.float32)
        for i in range(nodes):
            start = 1 + PERIOD // 2 * i
            plain[i, start : start + 2 * PERIOD - 1] = triangle(PERIOD)
        turn = 2 * np.pi * np.arange(length) / PERIOD
        return plain, (plain * np.cos(turn)).astype(np.float32), (plain * np.sin(turn)).astype(np.float32)

    rows, cols = (n - 2 * PADDING for n in grid.shape)
    down = np.concatenate(matrix(rows, SHAPE[0]))
    plain, cosine, sine = (m.T.copy() for m in matrix(cols, SHAPE[1]))

    def run(image: NDArray[np.uint8]) -> NDArray[np.float64]:
        mean, c, s = np.split(down @ image.astype(np.float32), 3)
        u = np.arctan2(-(mean @ sine), mean @ cosine)
        v = np.arctan2(-(s @ plain), c @ plain)
        return np.stack([u, v], axis=-1) * (PERIOD / (2 * np.pi))

    return run


def main() -> None:
    cv2.setNumThreads(1)
    grid = NodeGrid(SHAPE, PERIOD)
    null, truth = scene(0.6, 200.0)
    press, _ = scene(40.0, 100.0)
    contact, _ = scene(0.6, 200.0, hole=True)
    reference, _ = scene(0.0, 200.0)
    texture = ResidualSensor(
        grid,
        "noise",
        NOISE,
        8,
        light=lambda u, v: (
            0.5 + 0.1 * np.cos(0.21 * u + 0.34 * v) + 0.1 * np.cos(0.4 * u - 0.11 * v) + 0.1 * np.cos(0.3 * v)
        ),
    )
    cosines = ResidualSensor(grid, "cosines", NOISE, 8)
    checker = ResidualSensor(grid, "checker", NOISE, 8)
    blas, dis = blas_version(grid), cv2.DISOpticalFlow_create(cv2.DISOPTICAL_FLOW_PRESET_FAST)
    cases: dict[str, Callable[[], object]] = {
        "DIS fast": lambda: dis.calc(reference, null, None),
        "numpy/BLAS (phases only)": lambda: blas(null),
        "residual, near null": lambda: cosines.measure(null),
        "residual, near null, 16 bit words": lambda: cosines.measure(null16),
        "residual, sudden press of 40 px": lambda: cosines.measure(press),
        "residual, near null with a contact": lambda: cosines.measure(contact),
        "residual, checker": lambda: checker.measure(null),
        "residual, noise target": lambda: texture.measure(null),
    }
    null16 = null.astype(np.uint16)
    times: dict[str, list[float]] = {name: [] for name in cases}
    for turn in range(ROUNDS + 2):
        for name, case in cases.items():
            start = time.perf_counter()
            case()
            if turn >= 2:
                times[name].append(1e3 * (time.perf_counter() - start))
    nodes = grid.inner
    at = np.ix_(grid.v_px[nodes[0]].astype(int), grid.u_px[nodes[1]].astype(int))
    print(f"{platform.processor() or platform.machine()}, {SHAPE[1]}x{SHAPE[0]}, one thread, {ROUNDS} rounds")
    base = float(np.median(times["DIS fast"]))
    for name, values in times.items():
        p50, p99 = np.percentile(values, [50, 99])
        print(f"{name:36s} median {p50:7.2f} ms   p99 {p99:7.2f} ms   of DIS fast {p50 / base:6.3f}")
    measured = {"residual": cosines.measure(null).d[nodes], "numpy/BLAS": blas(null)}
    for name, d in measured.items():
        error = d - truth[at]
        print(
            f"{name:36s} rms error {1e3 * np.sqrt(np.mean(error**2)):7.2f} mpx (0.6 px bump, 2 grey of noise)"
        )


if __name__ == "__main__":
    main()
