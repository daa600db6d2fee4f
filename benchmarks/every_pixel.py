"""Every pixel: what a moving target and windows in time read, beside open loops on the same frames.

On the packaged bench with a pupil of 2.5 mm, a target that steps by sixteenths, 2 grey levels of noise and 8
bits. Narrow shapes in a view of 384 x 320 px of full size:

- Gaussian dents at half the depth at which they fold: the peak of the fine surface "as seen", against the
mirror
  averaged over the pupil's footprint and the lens's blur, and with the footprint and the lens's blur divided
  out, against the mirror;
- a wave of 0.6 mm pitch, 0.05 um high: its height against the response predicted from footprint and pixel;
- both by an open loop that steps its phases too (the picture of the mirror at rest stays, the same number of
  frames is fitted pixel by pixel), and by Fourier demodulation of each of these frames, averaged.

The whole view: depth at rest from 60 frames, at nodes and at pixels, and whether their scatter is as stated;
a pad of sigma 5 mm at 2, 10 and 50 um, binned by 2, against open loops of one frame and of the same number.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.peers.fourier_demodulation import carriers_of, displacement
from benchmarks.report import Figure, Report, benchmark, start
from benchmarks.rigs import VIEW_MIDDLE_MM, changed, coarser, opened, pressed
from zeromethod.arrays import Float, Image
from zeromethod.devices.protocols import TrueMirror
from zeromethod.fine.demodulate import Demodulated, Design
from zeromethod.fine.footprint import response
from zeromethod.fine.frames import FineFrame
from zeromethod.fine.reader import FRAMES, FineReader
from zeromethod.fine.surface import FineSurface
from zeromethod.optics import Optics
from zeromethod.optics.pupil import footprint_terms, quadratic_terms
from zeromethod.pattern import Target
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.fine import frame_of, with_moving_target
from zeromethod.surface import SurfaceReader, peak
from zeromethod.view.progress import Advance, progress
from zeromethod.warp.grid import NodeGrid

PUPIL_MM = 2.5
VIEW_PX = (384, 320)
DENTS: dict[float, tuple[float, float, float]] = {
    0.3: (1.1e-3, 1.0, 2.0), 0.5: (3e-3, 0.5, 1.0), 1.0: (12e-3, 0.3, 0.3), 1.5: (27e-3, 0.3, 0.3),
}  # fmt: skip
"""Sigma in mm: depth in mm, half of that of the fold; largest error as seen, and divided, percent."""
WAVE_MM, WAVE_HIGH_MM = 0.6, 5e-5
PADS_MM = (2e-3, 1e-2, 5e-2)
SETTLED = 24
"""Frames after the press before those that are read."""
REST_FRAMES = 60
_PRESS_S = 0.1
OPEN_GAIN = 1e-9
"""Gain of a loop that is open, and draws the picture at rest in every frame, so that its target steps."""


class FourierReader(FineReader):
    """Reads by Fourier demodulation of each frame, averaged over the frames, in place of the fit in time."""

    def _demodulated(self, images: Sequence[Image], design: Design) -> Demodulated:
        fit = super()._demodulated(images, design)
        rows, cols = images[0].shape
        v, u = np.mgrid[:rows, :cols].astype(float)
        period = self._grid.period_px
        ideal = np.rint(200 * Target("cosines", period).light(u, v)).astype(np.uint8)
        carriers, total = carriers_of(ideal, period), np.zeros((rows, cols, 2))
        for number, image in enumerate(images):
            waves = design.basis[:, number, 1::2] - 1j * design.basis[:, number, 2::2]
            turned = np.angle(waves)[:, None] / (2 * np.pi)
            d = displacement(image, carriers) / period - turned
            total += period * (d - np.rint(d))
        box = self._lattice.box
        mean = (total / len(images)).astype(np.float32)[box]
        return Demodulated(np.ascontiguousarray(mean), fit.variance, fit.modulation, fit.mean, fit.misfit)


@dataclass(frozen=True)
class Held:
    """What a bench saw of a mirror that stays: the last frames, and the mirror."""

    rig: Rig
    optics: Optics
    frames: Sequence[FineFrame]
    mirror: TrueMirror

    def read(self, kind: type[FineReader] = FineReader, divide: bool = True) -> FineSurface:
        """Fine surface of the frames."""
        return kind(self.rig, self.optics, self.grid, divide).read(self.frames)

    @property
    def grid(self) -> NodeGrid:
        """Nodes."""
        return NodeGrid.of_rig(self.rig)


def bench_rig(seed: int, view: tuple[int, int] | None = VIEW_PX, binning: int = 1, gain: float = 1.0) -> Rig:
    """The packaged bench with a pupil, and a target that moves. view: columns and rows of its middle."""
    rig = load_rig("simulated")
    camera: dict[str, Any] = {"pupil_mm": PUPIL_MM}
    if view is not None:
        camera |= {"columns": view[0], "rows": view[1], "centre_px": tuple((n - 1) / 2 for n in view)}
    rig = changed(rig, camera=camera, simulation={"seed": seed}, control={"gain": gain})
    return with_moving_target(coarser(rig, binning) if binning > 1 else rig)


def held(rig: Rig, count: int = FRAMES, settled: int = SETTLED) -> Held:
    """Run a bench until its press has settled and `count` more frames were seen."""
    frames: list[FineFrame] = []
    with opened(rig) as bench:
        before = round(_PRESS_S * rig.camera.rate_hz) + settled
        for number, step in enumerate(bench.loop.run(frames=before + count + 4)):
            frame = frame_of(step)
            if frame is not None and number >= before:
                frames.append(frame)
            mirror = bench.truth(step.time_ns)
        return Held(rig, bench.optics, frames[-count:], mirror)


@contextmanager
def waved(rig: Rig, along_x: bool) -> Iterator[Rig]:
    """The rig under a wave along x or y."""
    pitch, count = 0.025, 401
    at = pitch * (np.arange(count) - count // 2)
    rise = np.cos(2 * np.pi * at / WAVE_MM)
    depth = np.tile(rise, (count, 1)) if along_x else np.tile(rise[:, None], (1, count))
    edge = np.clip(2.5 - 0.5 * np.abs(at), 0.0, 1.0)
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "wave.npy", depth * np.outer(edge, edge))
        path = f"[{{time_s=0.0,x_mm={VIEW_MIDDLE_MM},y_mm=0.0,depth_mm={WAVE_HIGH_MM}}}]"
        press = Path(folder) / "wave.toml"
        press.write_text(f'[[press]]\nshape="map"\nfile="wave.npy"\npitch_mm={pitch}\npath={path}\n')
        yield rig.model_copy(update={"scenario": str(press)})


def footprint_px(rig: Rig) -> Float:
    """(2, 2) half widths of the footprint in the middle of the view, camera px by the pupil's unit disc."""
    middle = quadratic_terms(np.zeros(1), np.zeros(1))
    return np.asarray(np.einsum("rk,kij->rij", middle, footprint_terms(rig))[0])


def seen_peak_mm(one: Held, surface: FineSurface) -> float:
    """Depth of the mirror in the middle of the view, averaged over the footprint and the lens's blur."""
    row, col = (n // 2 for n in surface.depth_mm.shape)
    by_u = [float(np.gradient(f[row, col - 2 : col + 3])[2]) for f in (surface.x_mm, surface.y_mm)]
    by_v = [float(np.gradient(f[row - 2 : row + 3, col])[2]) for f in (surface.x_mm, surface.y_mm)]
    radius, angle = np.sqrt((np.arange(4000) + 0.5) / 4000), np.arange(4000) * np.pi * (3 - np.sqrt(5))
    u, v = footprint_px(one.rig) @ np.stack([radius * np.cos(angle), radius * np.sin(angle)])
    # Gauss-Hermite points of the blur, of lens and pixel
    offset, weight = (
        np.sqrt(3 * (one.rig.camera.psf_px**2 + 1 / 12)) * np.arange(-1, 2),
        np.array([1, 4, 1]) / 6,
    )
    u, v = (w[:, None, None] + o for w, o in ((u, offset[:, None]), (v, offset)))
    x, y = VIEW_MIDDLE_MM + by_u[0] * u + by_v[0] * v, by_u[1] * u + by_v[1] * v
    return float(np.mean(one.mirror.depth(x, y) @ weight @ weight))


def dents(seeds: int, advance: Advance) -> tuple[list[Figure], list[list[str]], dict[str, Any]]:
    """Peaks of narrow dents."""
    figures, rows, data = [], [], {}
    for sigma_mm, (depth_mm, most_seen, most_divided) in DENTS.items():
        errors: dict[str, list[float]] = {name: [] for name in ("seen", "divided", "raw", "open", "Fourier")}
        for seed in range(seeds):
            for gain in (1.0, OPEN_GAIN):
                rig = bench_rig(seed, gain=gain)
                with pressed(rig, [(_PRESS_S, 0.0), (_PRESS_S, depth_mm)], sigma_mm) as narrow:
                    one = held(narrow)
                divided = one.read()
                if gain == 1.0:
                    raw = one.read(divide=False)
                    errors["divided"].append(100 * (divided.peak[0] / depth_mm - 1))
                    errors["raw"].append(100 * (raw.peak[0] / depth_mm - 1))
                    errors["seen"].append(100 * (raw.peak[0] / seen_peak_mm(one, raw) - 1))
                else:
                    errors["open"].append(100 * (divided.peak[0] / depth_mm - 1))
                    errors["Fourier"].append(100 * (one.read(FourierReader).peak[0] / depth_mm - 1))
            advance(f"dent of {sigma_mm:g} mm")
        mean = {name: float(np.mean(values)) for name, values in errors.items()}
        data[f"{sigma_mm:g}"] = errors
        for name, most in (("seen", most_seen), ("divided", most_divided)):
            label = f"dent of sigma {sigma_mm:g} mm, {1e3 * depth_mm:g} um: {name}"
            figures.append(Figure(label, f"{mean[name]:+.2f} %", f"{most:g} %", abs(mean[name]) <= most))
        rows.append([f"{sigma_mm:g} mm", *(f"{mean[name]:+.2f}" for name in errors)])
    return figures, rows, data


def waves(advance: Advance) -> tuple[list[Figure], dict[str, Any]]:
    """Height of a wave, against what footprint and pixel leave of it."""
    figures, data = [], {}
    for along_x in (True, False):
        with waved(bench_rig(0), along_x) as rig:
            one = held(rig)
        surface = one.read(divide=False)
        row, col = (n // 2 for n in surface.depth_mm.shape)
        part = slice(row - 40, row + 41), slice(col - 30, col + 31)
        at = (surface.x_mm - VIEW_MIDDLE_MM if along_x else surface.y_mm)[part].astype(float).ravel()
        k = 2 * np.pi / WAVE_MM
        terms = np.stack([np.ones_like(at), at, np.cos(k * at), np.sin(k * at)], axis=-1)
        fit = np.linalg.lstsq(terms, surface.depth_mm[part].astype(float).ravel(), rcond=None)[0]
        height = float(np.hypot(*fit[2:])) / WAVE_HIGH_MM
        step_mm = abs(float(np.mean(np.diff(surface.x_mm[row] if along_x else surface.y_mm[:, col]))))
        wave = k * step_mm * np.array([1.0, 0.0] if along_x else [0.0, 1.0])
        predicted = float(response(np.asarray(np.linalg.norm(footprint_px(one.rig).T @ wave))))
        # the mirror's own spline, and the lens and the pixel, whose picture stays at rest below 8 px
        blur2 = one.rig.camera.psf_px**2 + 1 / 12
        predicted *= float(np.exp(-0.5 * blur2 * (k * step_mm) ** 2))
        name = f"wave of {WAVE_MM:g} mm along {'x' if along_x else 'y'}, {1e6 * WAVE_HIGH_MM:g} nm"
        met = abs(height / predicted - 1) <= 0.05
        figures.append(Figure(name, f"{height:.3f} of it, predicted {predicted:.3f}", "within 5 %", met))
        data[name] = [height, predicted]
        advance(name)
    return figures, data


def at_rest(seeds: int, advance: Advance) -> tuple[list[Figure], dict[str, Any]]:
    """Depth of the whole view at rest."""
    nodes, pixels, stated = [], [], []
    for seed in range(seeds):
        surface = held(bench_rig(seed, view=None).model_copy(update={"scenario": "none"}), REST_FRAMES).read(
            divide=False
        )
        coarse = surface.coarse
        nodes.append(1e6 * float(np.sqrt(np.mean(coarse.depth_mm[coarse.valid] ** 2))))
        pixels.append(1e6 * float(np.sqrt(np.mean(surface.depth_mm[surface.valid] ** 2))))
        stated.append(1e6 * float(np.sqrt(np.mean(surface.sigma_depth_mm[surface.valid] ** 2))))
        advance("rest")
    rms = [float(np.sqrt(np.mean(np.square(one)))) for one in (nodes, pixels, stated)]
    figures = [
        Figure(f"rest, {REST_FRAMES} frames: nodes", f"{rms[0]:.2f} nm", "0.95 nm", rms[0] <= 0.95),
        Figure(f"rest, {REST_FRAMES} frames: pixels", f"{rms[1]:.2f} nm", "1.2 nm", rms[1] <= 1.2),
        Figure("rest: scatter of pixels over stated sigma", f"{rms[1] / rms[2]:.2f}", "0.85 to 1.15",
               0.85 <= rms[1] / rms[2] <= 1.15),
    ]  # fmt: skip
    return figures, {"nodes_nm": nodes, "pixels_nm": pixels, "stated_nm": stated}


def pads(seeds: int, advance: Advance) -> tuple[list[Figure], list[list[str]], dict[str, Any]]:
    """Peaks of a pad of sigma 5 mm: null, the same open loop with and without steps."""
    rows, data = [], {}
    figures = []
    for depth_mm in PADS_MM:
        errors: dict[str, list[float]] = {name: [] for name in ("null", "open, stepping", "open, one frame")}
        for seed in range(seeds):
            for gain in (1.0, OPEN_GAIN):
                rig = bench_rig(seed, view=None, binning=2, gain=gain)
                with pressed(rig, [(_PRESS_S, 0.0), (_PRESS_S, depth_mm)]) as pad:
                    one = held(pad)
                surface = one.read(divide=False)
                name = "null" if gain == 1.0 else "open, stepping"
                errors[name].append(100 * (surface.peak[0] / depth_mm - 1))
                if gain != 1.0:
                    single = SurfaceReader(one.rig, one.optics, one.grid).read(one.frames[-1].measured)
                    errors["open, one frame"].append(100 * (peak(single).depth_mm / depth_mm - 1))
            advance(f"pad of {1e3 * depth_mm:g} um")
        rms = {name: float(np.sqrt(np.mean(np.square(values)))) for name, values in errors.items()}
        data[f"{1e3 * depth_mm:g}"] = errors
        rows.append([f"{1e3 * depth_mm:g} um", *(f"{rms[name]:.3f}" for name in errors)])
        if depth_mm < 0.02:
            third = rms["null"] <= rms["open, one frame"] / 3
            figures.append(Figure(f"pad of {1e3 * depth_mm:g} um: null over one open frame",
                                  f"{rms['null'] / rms['open, one frame']:.2f}", "1/3", third))  # fmt: skip
    return figures, rows, data


@benchmark("every_pixel", __doc__)
def command(quick: bool) -> Report:
    """Measure all parts."""
    seeds, wide = (2, 1) if quick else (20, 3)
    with progress(len(DENTS) * seeds + 2 + wide + len(PADS_MM) * wide) as advance:
        narrow, of_dents, dent_data = dents(seeds, advance)
        waved_figures, wave_data = waves(advance)
        rest, rest_data = at_rest(wide, advance)
        broad, of_pads, pad_data = pads(wide, advance)
    header = ["peak error, %", "as seen", "divided", "raw", "open, stepping, divided", "Fourier, divided"]
    blank = [""] * len(header)
    head = ["peak error, % rms", "null", "open, stepping", "open, one frame", "", ""]
    details = [header, *of_dents, blank, head, *([*row, "", ""] for row in of_pads)]
    data = {"dents": dent_data, "waves": wave_data, "rest": rest_data, "pads": pad_data, "seeds": seeds}
    title = f"Every pixel: {FRAMES} frames, pupil {PUPIL_MM:g} mm, {seeds} seeds"
    return Report(title, [*narrow, *waved_figures, *rest, *broad], details, data)


if __name__ == "__main__":
    start(command)
