"""What benches saw of small shapes and of a mirror at rest, with a pupil and a target that steps."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import salt
from benchmarks.peers.fourier_demodulation import carriers_of, displacement
from benchmarks.rigs import VIEW_MIDDLE_MM, changed, coarser, opened
from zeromethod.arrays import Float, Image
from zeromethod.devices.opening import open_devices
from zeromethod.devices.protocols import TrueMirror
from zeromethod.fine.demodulate import Demodulated, Design
from zeromethod.fine.footprint import response
from zeromethod.fine.frames import FRAMES, FineFrame
from zeromethod.fine.reader import FineReader
from zeromethod.fine.surface import FineSurface
from zeromethod.optics import Optics
from zeromethod.optics.pupil import footprint_terms, quadratic_terms
from zeromethod.pattern import Target
from zeromethod.pattern.renderer import PatternRenderer
from zeromethod.pattern.response import Response
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Rig
from zeromethod.session.fine import STEP, frame_of, with_moving_target
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.sensor import Sensor
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.rest import Rest

PUPIL_MM = 2.5
VIEW_PX = (384, 320)
WAVE_MM, WAVE_HIGH_MM = 0.6, 5e-5
SETTLED = 24
"""Frames after the press before those that are read."""
PRESS_S = 0.1
ALONG_V_OF_EIGHT = 3
"""Periods along v of eight steps, for one along u."""
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
        return replace(fit, d=np.ascontiguousarray(mean))


class EightStepReader(FineReader):
    """Reads by eight-step phase shifting, in place of the fit in time, from frames of their own.

    In those the mirror at rest's picture is shifted by k and 3 k eighths of a period: both carriers are kept
    apart by the same eight. Each picture stands still in its exposure.
    """

    def __init__(
        self, images: Sequence[Image], rig: Rig, optics: Optics, grid: NodeGrid, divide: bool
    ) -> None:
        super().__init__(rig, optics, grid, divide)
        self._images = images

    def _demodulated(self, images: Sequence[Image], design: Design) -> Demodulated:
        fit = super()._demodulated(images, design)
        v, u = np.ogrid[self._lattice.box]
        turn, d = 2 * np.pi / self._grid.period_px, np.empty_like(fit.d)
        for axis, (at, times) in enumerate(((u, 1), (v, ALONG_V_OF_EIGHT))):
            total = np.zeros(fit.mean.shape, np.complex64)
            for k, image in enumerate(self._images):
                total += image[self._lattice.box] * np.complex64(np.exp(-0.25j * np.pi * times * k))
            d[..., axis] = np.angle(total * np.exp(-1j * turn * at)) / turn
        return replace(fit, d=d)


def eight_steps(rig: Rig, count: int = FRAMES) -> list[Image]:
    """So many frames of the mirror after its press, the picture of the mirror at rest shifted by eighths."""
    optics = Optics(rig)
    rest = Rest.of(rig, optics)
    images = []
    with open_devices(rig) as devices:
        camera: Any = devices.camera
        display: Any = devices.display
        mirror, sensor = camera.scenario.mirror_at(round(1e9 * (PRESS_S + 1.0))), Sensor(rig)
        every_row = np.ones(rig.display.rows, np.float32)
        with display.context:
            target, response = Target.from_spec(rig.target), Response.from_rig(rig.display)
            drawing = PatternRenderer(display.context, rest.grid, rest.q, rest.display_size, target, response)
            pictures = [drawing.image(rest.q, shift=(k / 8, ALONG_V_OF_EIGHT * k / 8)) for k in range(8)]
        for number in range(count):
            handle = display.renderer.upload(pictures[number % 8])
            light = display.renderer.expose([Piece(1.0, mirror, [(handle, every_row)])])
            images.append(sensor.image(light, number))
            display.renderer.release(handle)
    return images


@dataclass(frozen=True)
class Held:
    """What a bench saw of a mirror that stays: the last frames, and the mirror."""

    rig: Rig
    optics: Optics
    frames: Sequence[FineFrame]
    mirror: TrueMirror

    def read(self, kind: Callable[..., FineReader] = FineReader, divide: bool = True) -> FineSurface:
        """Fine surface of the frames. kind: what makes the reader."""
        return kind(self.rig, self.optics, self.grid, divide).read(self.frames)

    @property
    def grid(self) -> NodeGrid:
        """Nodes."""
        return NodeGrid.of_rig(self.rig)


def bench_rig(
    seed: int, view: tuple[int, int] | None = VIEW_PX, binning: int = 1, gain: float = 1.0, step: int = STEP
) -> Rig:
    """The packaged bench with a pupil, and a target that moves by 1 / step of a period along u.

    view: columns and rows of its middle.
    """
    rig = load_rig("simulated")
    camera: dict[str, Any] = {"pupil_mm": PUPIL_MM}
    if view is not None:
        camera |= {"columns": view[0], "rows": view[1], "centre_px": tuple((n - 1) / 2 for n in view)}
    target = {"step": step}
    rig = changed(
        rig, camera=camera, target=target, simulation={"seed": salt.seed(seed)}, control={"gain": gain}
    )
    return with_moving_target(coarser(rig, binning) if binning > 1 else rig)


def held(rig: Rig, count: int = FRAMES, settled: int = SETTLED) -> Held:
    """Run a bench until its press has settled and `count` more frames were seen."""
    frames: list[FineFrame] = []
    with opened(rig) as bench:
        before = round(PRESS_S * rig.camera.rate_hz) + settled
        for number, step in enumerate(bench.loop.run(frames=before + count + 4)):
            frame = frame_of(step)
            if frame is not None and number >= before:
                frames.append(frame)
            mirror = bench.truth(step.time_ns)
        return Held(rig, bench.optics, frames[-count:], mirror)


@contextmanager
def waved(rig: Rig, along_x: bool, wave_mm: float = WAVE_MM) -> Iterator[Rig]:
    """The rig under a wave along x or y."""
    pitch, count = 0.025, 401
    at = pitch * (np.arange(count) - count // 2)
    rise = np.cos(2 * np.pi * at / wave_mm)
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


def wave_height(one: Held, along_x: bool, wave_mm: float) -> float:
    """Height of a wave in the middle of the view, as seen, over that of the mirror's."""
    surface = one.read(divide=False)
    row, col = (n // 2 for n in surface.depth_mm.shape)
    part = slice(row - 40, row + 41), slice(col - 30, col + 31)
    at = (surface.x_mm - VIEW_MIDDLE_MM if along_x else surface.y_mm)[part].astype(float).ravel()
    k = 2 * np.pi / wave_mm
    terms = np.stack([np.ones_like(at), at, np.cos(k * at), np.sin(k * at)], axis=-1)
    fit = np.linalg.lstsq(terms, surface.depth_mm[part].astype(float).ravel(), rcond=None)[0]
    return float(np.hypot(*fit[2:])) / WAVE_HIGH_MM


def predicted_height(rig: Rig, optics: Optics, along_x: bool, wave_mm: float) -> float:
    """What footprint, lens and pixel leave of a wave in the middle of the view."""
    u0, v0 = ((n - 1) / 2 for n in (rig.camera.columns, rig.camera.rows))
    u, v = np.array([u0, u0 + 1, u0]), np.array([v0, v0, v0 + 1])
    x, y = np.moveaxis(optics.trace(u, v, optics.rest).point[..., :2], -1, 0)
    step_mm = abs(float(x[1] - x[0] if along_x else y[2] - y[0]))
    turn = 2 * np.pi / wave_mm * step_mm
    wave = turn * np.array([1.0, 0.0] if along_x else [0.0, 1.0])
    seen = float(response(np.asarray(np.linalg.norm(footprint_px(rig).T @ wave))))
    # lens and pixel blur what the shown picture leaves: it is at rest below 8 px
    return seen * float(np.exp(-0.5 * (rig.camera.psf_px**2 + 1 / 12) * turn**2))
