"""What every pixel's sigma says while a pad slides, and what one frame's nodes would have been off by.

Against the mirror as the pupil shows it, which is what sigma is stated for.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from benchmarks.every_pixel.scenes import PRESS_S, bench_rig
from benchmarks.rigs import VIEW_MIDDLE_MM, opened, pressing
from zeromethod.arrays import Float
from zeromethod.devices.protocols import TrueMirror
from zeromethod.fine.frames import FRAMES, FineFrame
from zeromethod.fine.reader import FineReader
from zeromethod.optics.pupil import footprint_terms, quadratic_terms
from zeromethod.rig.model import Rig
from zeromethod.session.fine import frame_of
from zeromethod.surface import SurfaceReader

SPEEDS_MM_S = 0.0, 0.03, 0.3, 3.0, 10.0
DEPTH_MM, _SIGMA_MM = 0.05, 5.0
_BEGINS_S, _ENDS_S = 0.5, 1.5
_READ_AFTER = 54, 78
"""Frames after which the last ones are read: of all of them the pad slides."""


@contextmanager
def sliding(rig: Rig, mm_per_s: float) -> Iterator[Rig]:
    """The rig under a pad that is pressed, and slides along x from half a second on."""
    start, way = VIEW_MIDDLE_MM, mm_per_s * (_ENDS_S - _BEGINS_S)
    places = [(PRESS_S, start, 0.0), (PRESS_S, start, DEPTH_MM), (_BEGINS_S, start, DEPTH_MM)]
    places.append((_ENDS_S, start + way, DEPTH_MM))
    path = ",".join(f"{{time_s={t},x_mm={x},y_mm=0.0,depth_mm={depth}}}" for t, x, depth in places)
    with tempfile.TemporaryDirectory() as folder:
        press = Path(folder) / "pad.toml"
        press.write_text(f"[[press]]\n{pressing(_SIGMA_MM)}\npath=[{path}]\n")
        yield rig.model_copy(update={"scenario": str(press)})


def slide(mm_per_s: float, seed: int) -> dict[str, float]:
    """Root mean squares over both readings of a pad that slides: errors, nm, and over stated sigma.

    Of nodes and pixels, and of the nodes of the newest frame alone.
    """
    kept: list[FineFrame] = []
    found: dict[str, list[float]] = {}
    with sliding(bench_rig(seed, view=None, binning=2), mm_per_s) as rig, opened(rig) as bench:
        reader = FineReader(rig, bench.optics, bench.loop.grid, divide=False)
        alone = SurfaceReader(rig, bench.optics, bench.loop.grid)
        for number, step in enumerate(bench.loop.run(frames=max(_READ_AFTER)), 1):
            frame = frame_of(step)
            kept = [*kept, frame][-FRAMES:] if frame is not None else []
            if number not in _READ_AFTER or len(kept) < FRAMES:
                continue
            fine, mirror = reader.read(kept), bench.truth(kept[-1].measured.time_ns)
            surfaces = ("nodes", fine.coarse), ("pixels", fine), ("one frame", alone.read(kept[-1].measured))
            for name, one in surfaces:
                off = one.depth_mm - _as_seen(mirror, rig, one.x_mm.astype(float), one.y_mm.astype(float))
                found.setdefault(f"{name}, nm", []).append(1e12 * float(np.nanmean(off**2)))
                ratio2 = float(np.nanmean((off / one.sigma_depth_mm) ** 2))
                found.setdefault(f"{name}, over sigma", []).append(ratio2)
    return {name: float(np.sqrt(np.mean(values))) for name, values in found.items()}


def _as_seen(mirror: TrueMirror, rig: Rig, x: Float, y: Float) -> Float:
    """Depth (rows, cols), mm, averaged over the pupil's footprint, at mirror points evenly over the view."""
    rows, cols = x.shape
    t, s = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, cols), indexing="ij")
    shift = np.einsum("rck,kij->ijrc", quadratic_terms(s, t), footprint_terms(rig))
    per_px = cols / rig.camera.columns, rows / rig.camera.rows
    by_px = [[step * one for one, step in zip(np.gradient(of)[::-1], per_px, strict=True)] for of in (x, y)]
    total = np.zeros(x.shape)
    # four points with the second moments of a disc
    for axis, side in ((0, 0.5**0.5), (0, -(0.5**0.5)), (1, 0.5**0.5), (1, -(0.5**0.5))):
        off_x, off_y = (side * (u * shift[0, axis] + v * shift[1, axis]) for u, v in by_px)
        total += 0.25 * mirror.depth(x + off_x, y + off_y)
    return total
