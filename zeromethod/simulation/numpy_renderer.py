"""The reference bench: exact rays and exact aperture integrals on the CPU, written for clarity."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import count

import numpy as np

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.pattern.response import Response
from zeromethod.rig.model import Rig
from zeromethod.simulation.aperture import gather
from zeromethod.simulation.beams import Beams
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.projected import ProjectedWays
from zeromethod.simulation.renderer import Handle, Piece, by_mirror, check_picture, mirror_shares

_KEPT_MIRRORS = 3
"""Ray maps kept: rest, and the two instants of a moving exposure."""


class NumpyRenderer:
    """`BenchRenderer` in numpy; see there for what the light means."""

    def __init__(self, rig: Rig) -> None:
        """Lay out the rays. Raises InputError where the rig's rest surface cannot be used."""
        self._rig = rig
        self._response = Response.from_rig(rig.display)
        self._pictures: dict[Handle, Float] = {}
        self._names = count(1)
        self.move(rig)

    def move(self, rig: Rig) -> None:
        """Have camera and LCD where `rig` has them."""
        self._beams, self._projected = Beams(rig), ProjectedWays(rig)
        self._beams_of = lru_cache(_KEPT_MIRRORS)(self._beams.all)

    def upload(self, image: Bytes) -> Handle:
        """Take over LCD grey codes (rows, cols); raises InputError for another shape or type."""
        check_picture(image, self._rig.display)
        handle = next(self._names)
        self._pictures[handle] = self._response.light(np.arange(256))[image]
        if self._response.exponent is not None:
            self._pictures[handle] **= self._response.exponents(image.shape)
        return handle

    def release(self, handle: Handle) -> None:
        """Forget a picture."""
        del self._pictures[handle]

    def expose(self, pieces: Sequence[Piece], projected: Single | None = None) -> Single:
        """Mean light (camera rows, cols); see `BenchRenderer.expose`."""
        display, camera = self._rig.display, self._rig.camera
        stripes = 3 if display.stripes == "rgb" else 1
        out = np.zeros((camera.rows, camera.columns))
        for mirror, shares in by_mirror(pieces).items():
            light = np.zeros((display.rows, display.columns))
            for handle, share in shares.items():
                light += share[:, None] * self._pictures[handle]
            beams, scattered = self._beams_of(mirror)
            if scattered is not None:
                out += scattered * light.mean()
            for beam in beams:
                footprint = beam.q, beam.by_u, beam.by_v, beam.gain
                gather(light, *footprint, display.fill_factor, stripes, camera.psf_px, out)
        if projected is not None:
            for mirror, part in mirror_shares(pieces).items():
                out += part * self._projected.light(mirror, projected)
        out += self._rig.simulation.ambient
        return out.astype(np.float32)

    def ray_map(self, mirror: Mirror) -> tuple[Single, Single]:
        """(q, reflectance) of the main beam at camera pixel centres."""
        q, gain = self._beams.main(mirror)
        lost = np.isnan(q[..., 0])
        return q.astype(np.float32), np.where(lost, 0.0, gain).astype(np.float32)

    def close(self) -> None:
        """Forget all pictures and maps."""
        self._pictures.clear()
        self._beams_of.cache_clear()
