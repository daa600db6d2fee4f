"""Still images of many textures, against themselves and moved: what is called valid, and how much is wrong.

Every picture is a formula, seen through a lens blur and square pixels, with fresh noise of `NOISE_GREY` and
8 bits. A point is wrong where either component is off by more than 3 of its sigmas; the table gives the
share of valid points, and the share of wrong ones among all points.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import click
import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.cli.numbers import Whole
from zeromethod.passive import Displacement, correlate

Grey = NDArray[np.float64]
Texture = Callable[[Grey, Grey], Grey]

SHAPE = 240, 320
NOISE_GREY = 1.0
LENS_PX = 0.7
"""Standard deviation of the lens's blur; the pixels are square and full."""

_FINER = 4
LEAST_VALID = 0.05
"""Less than this is no measurement, and `zeromethod measure` says so."""

DIRECTION = (np.cos(np.deg2rad(25.0)), np.sin(np.deg2rad(25.0)))
SHIFTS_PX = (0.1, 0.4, 1.3, 3.0, 6.7, 13.0, 22.0, 40.0)
CASES = ("no noise", "itself", "fresh noise", *(f"{shift:g} px" for shift in SHIFTS_PX))


def _random(sigma_px: float, seed: int = 1, mean: float = 120.0, contrast: float = 40.0) -> Texture:
    """Smoothed noise, far beyond the view on all sides."""
    noise = np.random.default_rng(seed).normal(size=(900, 1000))
    grey = cv2.GaussianBlur(noise, (0, 0), sigma_px)
    grey = mean + contrast * grey / grey.std()
    return lambda u, v: map_coordinates(grey, [v + 200, u + 200], order=3, mode="mirror")


def _natural(u: Grey, v: Grey) -> Grey:
    """1/f amplitude."""
    rng = np.random.default_rng(4)
    f = np.hypot(np.fft.fftfreq(1024)[:, None], np.fft.fftfreq(1024)[None, :])
    f[0, 0] = 1.0
    grey = np.fft.ifft2(np.fft.fft2(rng.normal(size=f.shape)) / f).real
    grey = 120.0 + 40.0 * grey / grey.std()
    return np.asarray(map_coordinates(grey, [v + 200, u + 200], order=3, mode="wrap"))


def _spots(u: Grey, v: Grey, centres: Grey, sigma_px: float, height: float) -> Grey:
    out = np.zeros_like(u)
    step = u[0, 1] - u[0, 0]
    reach = int(np.ceil(4 * sigma_px / step))
    rows, cols = u.shape
    for x, y in centres:
        i, j = round((x - u[0, 0]) / step), round((y - v[0, 0]) / step)
        a, b, c, d = max(j - reach, 0), min(j + reach, rows), max(i - reach, 0), min(i + reach, cols)
        if a < b and c < d:
            r2 = (u[a:b, c:d] - x) ** 2 + (v[a:b, c:d] - y) ** 2
            out[a:b, c:d] += height * np.exp(-0.5 * r2 / sigma_px**2)
    return out


def _dot_grid(pitch_px: float, sigma_px: float) -> Texture:
    places = np.arange(-60, 60) * pitch_px
    centres = np.stack(np.meshgrid(places, places), axis=-1).reshape(-1, 2)
    return lambda u, v: 30.0 + _spots(u, v, centres, sigma_px, 170.0)


def _scattered_dots(u: Grey, v: Grey) -> Grey:
    centres = np.random.default_rng(6).uniform(-200, 700, size=(1400, 2))
    return 30.0 + _spots(u, v, centres, 1.7, 170.0)


def _checkerboard(side_px: float) -> Texture:
    c, s = np.cos(0.2), np.sin(0.2)
    k = np.pi / side_px
    return lambda u, v: 120.0 + 80.0 * np.sign(np.sin(k * (c * u + s * v)) * np.sin(k * (c * v - s * u)))


def _lattice(u: Grey, v: Grey) -> Grey:
    k = 2 * np.pi / 16.0
    return np.asarray(120.0 + 40.0 * np.cos(k * u) + 40.0 * np.cos(k * v))


def _grating(u: Grey, v: Grey) -> Grey:
    return np.asarray(120.0 + 70.0 * np.cos(2 * np.pi / 12.0 * (np.cos(0.3) * u + np.sin(0.3) * v)))


def _text(u: Grey, v: Grey) -> Grey:
    """Lines of letters (random strokes) in rows of 14 px, with even gaps between the lines."""
    rng = np.random.default_rng(8)
    page = np.full((900, 1000), 220.0, np.float32)
    for line in range(0, 880, 14):
        x = rng.integers(0, 10)
        while x < 990:
            for _ in range(3):
                p, q = rng.integers(0, 6, 2), rng.integers(0, 8, 2)
                cv2.line(page, (int(x + p[0]), int(line + q[0])), (int(x + p[1]), int(line + q[1])), 40.0, 1)
            x += 8 if rng.uniform() < 0.85 else 16
    return np.asarray(map_coordinates(page, [v + 200, u + 200], order=1, mode="mirror"))


def _gradient(u: Grey, v: Grey) -> Grey:
    return np.asarray(40.0 + 0.3 * u + 0.25 * v)


def _tiles(u: Grey, v: Grey) -> Grey:
    """One random tile of 37 x 31 px over and over."""
    tile = cv2.GaussianBlur(np.tile(np.random.default_rng(9).normal(size=(31, 37)), (3, 3)), (0, 0), 2.0)
    tile = tile[31:62, 37:74]
    return np.asarray(
        120.0 + 40.0 / tile.std() * map_coordinates(tile, [v % 31, u % 37], order=1, mode="grid-wrap")
    )


def _saturated(u: Grey, v: Grey) -> Grey:
    return np.clip(_random(3.0, 11, 180.0, 90.0)(u, v), 0.0, 255.0)


def _low_contrast(u: Grey, v: Grey) -> Grey:
    return _random(2.0, 12, 120.0, 1.5)(u, v)


def _low_contrast_coarse(u: Grey, v: Grey) -> Grey:
    return _random(8.0, 12, 120.0, 3.0)(u, v)


def _hole(u: Grey, v: Grey) -> Grey:
    return np.where(np.hypot(u - 150, v - 110) < 55, 12.0, _random(2.0, 13)(u, v))


def _even(u: Grey, _v: Grey) -> Grey:
    return np.full_like(u, 120.0)


TEXTURES: dict[str, Texture] = {
    "fine speckle": _random(1.3),
    "coarse speckle": _random(5.0, 2),
    "sparse dot grid": _dot_grid(24.0, 1.5),
    "very sparse dot grid": _dot_grid(40.0, 1.5),
    "scattered dots": _scattered_dots,
    "checkerboard": _checkerboard(14.0),
    "lattice": _lattice,
    "grating": _grating,
    "text": _text,
    "natural 1/f": _natural,
    "gradient only": _gradient,
    "even": _even,
    "repeated tiles": _tiles,
    "saturated": _saturated,
    "low contrast": _low_contrast,
    "low contrast, coarse": _low_contrast_coarse,
    "dark hole": _hole,
    "black borders": _random(2.0, 14),
    "dots, black borders": _dot_grid(24.0, 1.5),
}
"""Black borders stand still; the hole moves with the texture."""


PERIODS_PX = {
    "sparse dot grid": 24.0,
    "very sparse dot grid": 40.0,
    "checkerboard": 14.0 * np.sqrt(2.0),
    "lattice": 16.0,
    "repeated tiles": 31.0,
    "dots, black borders": 24.0,
}
"""Shortest repeats. Each of these textures is measured again, with nothing moved by half of it as a given."""


def picture(name: str, shape: tuple[int, int], shift: tuple[float, float]) -> Grey:
    """Picture (rows, cols) without noise whose content has moved by shift px."""
    pad = 4 * _FINER
    rows, cols = (_FINER * n + 2 * pad for n in shape)
    u = (np.arange(cols) - pad + 0.5) / _FINER - 0.5 - shift[0]
    v = (np.arange(rows) - pad + 0.5) / _FINER - 0.5 - shift[1]
    grey = TEXTURES[name](*np.meshgrid(u, v))
    if "borders" in name:
        x, y = np.meshgrid((u + shift[0]) / shape[1], (v + shift[1]) / shape[0])
        grey = np.where((np.abs(x - 0.5) < 0.33) & (np.abs(y - 0.5) < 0.33), grey, 8.0)
    seen = cv2.GaussianBlur(grey, (0, 0), LENS_PX * _FINER)[pad:-pad, pad:-pad]
    return np.asarray(seen.reshape(shape[0], _FINER, shape[1], _FINER).mean(axis=(1, 3)))


def noisy(grey: Grey, rng: np.random.Generator, noise_grey: float = NOISE_GREY) -> NDArray[np.uint8]:
    """Picture with noise, as an 8 bit camera gives it."""
    return np.clip(np.rint(grey + noise_grey * rng.normal(size=grey.shape)), 0, 255).astype(np.uint8)


def judged(found: Displacement, shift: tuple[float, float]) -> dict[str, float]:
    """Shares of all points: valid, wrong (valid, yet beyond 3 sigma), right (valid otherwise)."""
    pull = np.maximum(
        np.abs(found.du - shift[0]) / found.sigma_u, np.abs(found.dv - shift[1]) / found.sigma_v
    )
    wrong = found.valid & ~(pull <= 3.0)
    error = np.hypot(found.du - shift[0], found.dv - shift[1])[found.valid]
    return {
        "valid": float(found.valid.mean()),
        "wrong": float(wrong.mean()),
        "right": float((found.valid & ~wrong).mean()),
        "close": float((error < 0.1).sum() / found.valid.size),
        "worst_px": float(error.max()) if error.size else 0.0,
        "pull_rms": float(np.sqrt(np.mean(pull[found.valid] ** 2))) if error.size else 0.0,
    }


def run(
    name: str, shape: tuple[int, int], seeds: int, largest_px: float | None = None
) -> dict[str, dict[str, float]]:
    """Figures per case of one texture, means over seeds."""
    out: dict[str, dict[str, float]] = {}
    still = picture(name, shape, (0.0, 0.0))
    for case, length in zip(CASES, (0.0, 0.0, 0.0, *SHIFTS_PX), strict=True):
        if largest_px is not None and length > largest_px:
            continue
        shift = (length * DIRECTION[0], length * DIRECTION[1])
        moved = picture(name, shape, shift) if length else still
        found = []
        for seed in range(seeds):
            # Noise of its own in every case: with the same one, all of them would err alike.
            rng = np.random.default_rng([100 + seed, CASES.index(case)])
            reference = noisy(still, rng, 0.0 if case == "no noise" else NOISE_GREY)
            image = reference if case in ("no noise", "itself") else noisy(moved, rng)
            started = time.perf_counter()
            displacement = correlate(reference, image, largest_shift_px=largest_px)
            seconds = time.perf_counter() - started
            found.append({**judged(displacement, shift), "s": seconds})
        out[case] = {
            key: max(one[key] for one in found)
            if key == "worst_px"
            else float(np.mean([one[key] for one in found]))
            for key in found[0]
        }
    return out


def _shares(table: dict[str, dict[str, float]]) -> list[float]:
    """Share of the valid points that is wrong, in each case with fresh noise that has some; 0 for none."""
    cases = [case for at, case in table.items() if at not in ("no noise", "itself")]
    return [case["wrong"] / case["valid"] for case in cases if case["valid"] > LEAST_VALID] or [0.0]


def report(names: Sequence[str], seeds: int) -> Report:
    """Every texture, and the repeating ones again with the largest shift stated."""
    tables: dict[str, dict[str, dict[str, float]]] = {}
    for name in names:
        tables[name] = run(name, SHAPE, seeds)
        if name in PERIODS_PX:
            tables[f"{name}, largest shift stated"] = run(name, SHAPE, seeds, 0.45 * PERIODS_PX[name])
    details = [["texture: valid %, beyond 3 sigma %", *CASES]]
    details += [
        [name, *(f"{100 * case['valid']:.1f}, {100 * case['wrong']:.1f}" for case in table.values())]
        + [""] * (len(CASES) - len(table))
        for name, table in tables.items()
    ]
    wrong = max(
        (case["wrong"], f"{name}, {at}") for name, table in tables.items() for at, case in table.items()
    )
    # One picture holds as few as ten independent windows: what is honest shows in all cases together.
    means = max((float(np.mean(_shares(table))), name) for name, table in tables.items())
    itself = max(table[at]["wrong"] for table in tables.values() for at in ("no noise", "itself"))
    figures = [
        Figure(
            "points beyond 3 sigma of an image against itself, worst", f"{itself:.1%}", "1 %", itself <= 0.01
        ),
        Figure(
            f"valid points beyond 3 sigma, mean over the noisy cases, worst texture ({means[1]})",
            f"{means[0]:.1%}",
            "1 %",
            means[0] <= 0.01,
        ),
        Figure(f"points beyond 3 sigma, worst single case ({wrong[1]})", f"{wrong[0]:.1%}"),
    ]
    return Report("Displacement of still images, texture by texture", figures, details, {"tables": tables})


@benchmark(
    "passive_textures",
    __doc__,
    click.option("--seeds", type=Whole(min=1), default=1, show_default=True, help="Draws of noise."),
    click.option(
        "--only", type=click.Choice(list(TEXTURES)), multiple=True, help="This texture; may be repeated."
    ),
)
def command(quick: bool, seeds: int, only: tuple[str, ...]) -> Report:
    """Measure the textures asked for."""
    names = only or tuple(TEXTURES)
    return report(names[:3] if quick else names, seeds)


if __name__ == "__main__":
    start(command)
