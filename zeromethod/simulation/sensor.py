"""From light to grey levels: gain, shot and read noise, black level, fixed pattern, quantisation."""

from __future__ import annotations

import numba
import numpy as np

from zeromethod.arrays import Flags, Image, Single
from zeromethod.kernels import kernel, read
from zeromethod.rig.model import Rig

_STREAM = 3
_PATTERN_STREAM = 4


@kernel(
    read(numba.float32, 2),
    read(numba.float32, 2),
    read(numba.float32, 2),
    read(numba.float32, 2),
    numba.float64,
    numba.float64,
    numba.float64,
    numba.float64,
    numba.float64,
    numba.uint16[:, ::1],
    fastmath=True,
)
def _expose(
    light: Single,
    normal: Single,
    gain: Single,
    offset: Single,
    peak: float,
    black: float,
    read: float,
    grey_per_electron: float,
    full: float,
    out: Flags,
) -> None:
    """Grey levels (rows, cols) by light, standard normal noise, and each pixel's gain and black level."""
    for row in range(light.shape[0]):
        for col in range(light.shape[1]):
            signal = gain[row, col] * light[row, col] * peak
            spread = np.sqrt(read * read + max(signal, 0.0) * grey_per_electron)
            grey = np.rint(black + offset[row, col] + signal + spread * normal[row, col])
            out[row, col] = min(max(grey, 0.0), full)


class Sensor:
    """The camera's chip.

    Light 1 gives `peak_grey_share` of the full scale 2^bits - 1, light 0 the black level. Variance =
    read_grey^2 + signal / electrons_per_grey, the signal counted above black. The noise of frame n
    depends on seed and n alone. Every pixel has its own gain and black level, by the seed, which stay from
    frame to frame (`simulation.nuisances.pixel_gain`, `pixel_offset_grey`). Quantisation rounds to the
    nearest grey level and clips.
    """

    def __init__(self, rig: Rig, stream: int = _STREAM) -> None:
        """Chip of the rig's camera. stream: keeps its noise apart from other noise under the same seed."""
        camera, noise = rig.camera, rig.camera.noise
        self._full = float(2**camera.bits - 1)
        self._black = noise.black_grey
        self._peak = rig.simulation.peak_grey_share * self._full - self._black
        self._read = noise.read_grey
        self._grey_per_electron = 1.0 / noise.electrons_per_grey if noise.electrons_per_grey else 0.0
        self._dtype = np.uint8 if camera.bits <= 8 else np.uint16
        self._seed, self._stream = rig.simulation.seed, stream
        shape = camera.rows, camera.columns
        self._normal = np.zeros(shape, dtype=np.float32)
        nuisances = rig.simulation.nuisances
        self._gain, self._offset = np.ones(shape, np.float32), np.zeros(shape, np.float32)
        if nuisances.pixel_gain or nuisances.pixel_offset_grey:
            seeds = np.random.SeedSequence((self._seed & (2**64 - 1), _PATTERN_STREAM))
            pattern = np.random.default_rng(seeds).standard_normal((2, *shape), dtype=np.float32)
            self._gain += np.float32(nuisances.pixel_gain) * pattern[0]
            self._offset += np.float32(nuisances.pixel_offset_grey) * pattern[1]

    @property
    def noisy(self) -> bool:
        """Whether any noise is asked for."""
        return self._read > 0 or self._grey_per_electron > 0

    def image(self, light: Single, number: int) -> Image:
        """Grey levels (rows, cols) uint8 or uint16, newly allocated, of frame `number` under `light`."""
        if self.noisy:
            seeds = np.random.SeedSequence((self._seed & (2**64 - 1), self._stream, number & (2**64 - 1)))
            np.random.Generator(np.random.SFC64(seeds)).standard_normal(dtype=np.float32, out=self._normal)
        out = np.empty(light.shape, np.uint16)
        pattern, noise = (self._gain, self._offset), (self._read, self._grey_per_electron)
        _expose(light, self._normal, *pattern, self._peak, self._black, *noise, self._full, out)
        return out.astype(self._dtype, copy=False)
