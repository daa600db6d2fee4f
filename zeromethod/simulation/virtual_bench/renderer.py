"""The bench drawn on one core: rays on a lattice, light through a tabulated lens."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from math import sqrt

import numba
import numpy as np

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.rig.model import Rig
from zeromethod.simulation.gpu_lens import LEAST_PSF_PX, SIGMAS, before
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.panel import light_of_codes
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import BenchRenderer, Handle, Piece
from zeromethod.simulation.virtual_bench.rays import LatticeRays

_STEPS = 4096
"""Entries of the lens's table: linear between them it is right to 1e-6."""
_SHEAR = 0.01
"""Correlation of a footprint's axes that is left out."""
_LEAST_PX = 1e-2
_KEPT_MIRRORS = 2
_THREADS = 2
"""Threads that gather light: a frame is ready sooner where a core is idle."""


def bending_renderer(rig: Rig) -> BenchRenderer:
    """The fastest renderer for this rig.

    `LatticeRenderer`; for ghosts, colour stripes or a lens without blur, which it leaves out, the one that
    the rig names, to be used in this thread. Raises InputError where the rest surface cannot be used, or
    without OpenGL where that is needed.
    """
    simulation = rig.simulation
    ghosts = simulation.ghost_faces > 0 or simulation.ghost_gap > 0
    plain = rig.display.stripes == "none" and rig.camera.psf_px >= LEAST_PSF_PX and not ghosts
    if plain:
        return LatticeRenderer(rig)
    if simulation.renderer == "numpy":
        return NumpyRenderer(rig)
    from zeromethod.simulation.gpu import GpuRenderer  # noqa: PLC0415 - OpenGL only where it is needed

    return GpuRenderer(rig)


class LatticeRenderer:
    """`BenchRenderer` for a mirror that moves with every frame, without a GPU.

    As the other renderers, but that rays between the nodes of a lattice are interpolated (see `LatticeRays`)
    and that there are no ghosts and no colour stripes.
    """

    def __init__(self, rig: Rig) -> None:
        """Lay out the rays. Raises InputError where the rig's rest surface cannot be used."""
        self._rig = rig
        self._rays = LatticeRays(rig)
        self._response = light_of_codes(rig.display).astype(np.float32)
        psf_px = rig.camera.psf_px
        self._reach = 0.5 + SIGMAS * psf_px
        self._lens = before(np.linspace(-self._reach, self._reach, _STEPS + 1), psf_px).astype(np.float32)
        self._spread = sqrt(psf_px**2 + 1.0 / 12.0)
        self._pictures: dict[Handle, Single] = {}
        self._names = count(1)
        self._maps: OrderedDict[Mirror, tuple[Float, Float]] = OrderedDict()
        self._bands = [round(band * rig.camera.rows / _THREADS) for band in range(_THREADS + 1)]
        self._pool = ThreadPoolExecutor(_THREADS, "bending")

    def upload(self, image: Bytes) -> Handle:
        """Take over LCD grey codes (rows, cols)."""
        handle = next(self._names)
        self._pictures[handle] = self._response[image]
        return handle

    def release(self, handle: Handle) -> None:
        """Forget a picture."""
        del self._pictures[handle]

    def expose(self, pieces: Sequence[Piece]) -> Single:
        """Mean light (camera rows, cols); see `BenchRenderer.expose`."""
        out = np.full(
            (self._rig.camera.rows, self._rig.camera.columns), self._rig.simulation.ambient, np.float32
        )
        by_mirror: dict[Mirror, Single] = {}
        for piece in pieces:
            light = self._panel_light(piece)
            earlier = by_mirror.get(piece.mirror)
            by_mirror[piece.mirror] = light if earlier is None else earlier + light
        for mirror, light in by_mirror.items():
            q, gain = self._map(mirror)
            bands = zip(self._bands, self._bands[1:], strict=False)
            done = [self._pool.submit(self._gather, light, q, gain, out, *band) for band in bands]
            for each in done:
                each.result()
        return out

    def ray_map(self, mirror: Mirror) -> tuple[Single, Single]:
        """(q, reflectance) at camera pixel centres."""
        q, gain = self._map(mirror)
        return q.astype(np.float32), gain.astype(np.float32)

    def close(self) -> None:
        """Forget all pictures and maps."""
        self._pool.shutdown()
        self._pictures.clear()
        self._maps.clear()

    def _map(self, mirror: Mirror) -> tuple[Float, Float]:
        if mirror not in self._maps:
            self._maps[mirror] = self._rays.trace(mirror)
        self._maps.move_to_end(mirror)
        while len(self._maps) > _KEPT_MIRRORS:
            self._maps.popitem(last=False)
        return self._maps[mirror]

    def _gather(self, light: Single, q: Float, gain: Float, out: Single, first: int, end: int) -> None:
        fill = self._rig.display.fill_factor
        _gather(light, q, gain, fill, self._lens, self._reach, self._spread, first, end, out)

    def _panel_light(self, piece: Piece) -> Single:
        if len(piece.pictures) == 1 and piece.weight == 1.0 and (piece.pictures[0][1] == 1.0).all():
            return self._pictures[piece.pictures[0][0]]
        parts = [
            np.float32(piece.weight) * share[:, None] * self._pictures[name] for name, share in piece.pictures
        ]
        total: Single = np.sum(parts, axis=0, dtype=np.float32)
        return total


@numba.njit(cache=True, inline="always")
def _step(q: Float, row: int, col: int, down: int, right: int, axis: int) -> float:
    """Change of q over one camera px: central, one-sided next to a lost ray or the border."""
    here, rise, sides = q[row, col, axis], 0.0, 0
    if row + down < q.shape[0] and col + right < q.shape[1]:
        after = q[row + down, col + right, axis]
        if not np.isnan(after):
            rise += after - here
            sides += 1
    if row >= down and col >= right:
        earlier = q[row - down, col - right, axis]
        if not np.isnan(earlier):
            rise += here - earlier
            sides += 1
    return rise / max(sides, 1)


@numba.njit(cache=True, fastmath=True, inline="always")
def _shares(
    middle: float, size: float, fill: float, count: int, lens: Single, reach: float, out: Single
) -> tuple[int, int]:
    """Share of the response that falls on each LCD pixel's aperture: pixels [first, end), from out[0] on.

    One axis: middle in LCD px, `size` LCD px per camera px, `count` LCD pixels.
    """
    first = max(int(np.floor(middle - reach * size + 0.5)), 0)
    end = min(int(np.floor(middle + reach * size + 0.5)) + 1, count, first + len(out))
    per_camera_px = np.float32((len(lens) - 1) / (2.0 * reach))
    step = per_camera_px / np.float32(size)
    last = np.float32(len(lens) - 1) - np.float32(1e-3)
    start = np.float32(first - 0.5 * fill - middle) * step + np.float32(reach) * per_camera_px
    wide = np.float32(fill) * step
    for pixel in range(end - first):
        low = min(max(start + np.float32(pixel) * step, np.float32(0.0)), last)
        high = min(max(start + np.float32(pixel) * step + wide, np.float32(0.0)), last)
        i, j = np.int32(low), np.int32(high)
        before = lens[i] + (low - np.float32(i)) * (lens[i + 1] - lens[i])
        out[pixel] = lens[j] + (high - np.float32(j)) * (lens[j + 1] - lens[j]) - before
    return first, end


@numba.njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "arcp"})
def _gather(
    light: Single,
    q: Float,
    gain: Float,
    fill: tuple[float, float],
    lens: Single,
    reach: float,
    spread: float,
    first_row: int,
    end_row: int,
    out: Single,
) -> None:
    """Add gain x mean light that camera pixels gather to `out`, as `zeromethod.simulation.aperture` has it.

    Rows from first_row on, up to end_row. lens: response before -reach ... reach (camera px). spread: its
    standard deviation, camera px. A sheared footprint is two along the LCD's axes, set apart along the shear.
    """
    columns = np.empty(light.shape[1], dtype=np.float32)
    rows = np.empty(light.shape[0], dtype=np.float32)
    for row in range(first_row, end_row):
        for col in range(q.shape[1]):
            if gain[row, col] <= 0.0:
                continue
            ux, uy = _step(q, row, col, 0, 1, 0), _step(q, row, col, 0, 1, 1)
            vx, vy = _step(q, row, col, 1, 0, 0), _step(q, row, col, 1, 0, 1)
            wide = max(sqrt(ux * ux + vx * vx), _LEAST_PX)
            high = max(sqrt(uy * uy + vy * vy), _LEAST_PX)
            shear = (ux * uy + vx * vy) / (wide * high)
            parts, x, y = 1, 0.0, 0.0
            if abs(shear) >= _SHEAR:
                parts = 2
                apart = spread * sqrt(abs(shear))
                x, y = apart * wide, apart * high * np.sign(shear)
                narrowed = sqrt(max(1.0 - abs(shear), 0.01))
                wide, high = narrowed * wide, narrowed * high
            total = np.float32(0.0)
            for k in range(parts):
                side = 1.0 - 2.0 * k
                left, right = _shares(
                    q[row, col, 0] + side * x, wide, fill[0], light.shape[1], lens, reach, columns
                )
                top, bottom = _shares(
                    q[row, col, 1] + side * y, high, fill[1], light.shape[0], lens, reach, rows
                )
                for j in range(top, bottom):
                    line = np.float32(0.0)
                    for i in range(left, right):
                        line += columns[i - left] * light[j, i]
                    total += rows[j - top] * line
            out[row, col] += gain[row, col] * total / (parts * fill[0] * fill[1])
