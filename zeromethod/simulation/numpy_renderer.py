"""The reference bench: exact rays and exact aperture integrals on the CPU, written for clarity."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig
from zeromethod.simulation.aperture import gather
from zeromethod.simulation.beams import Beams
from zeromethod.simulation.panel import exponents, light_of_codes
from zeromethod.simulation.press import Mirror
from zeromethod.simulation.renderer import Handle, Piece

_KEPT_MIRRORS = 3
"""Ray maps kept: rest, and the two instants of a moving exposure."""


class NumpyRenderer:
    """`BenchRenderer` in numpy; see there for what the light means."""

    def __init__(self, rig: Rig) -> None:
        """Lay out the rays. Raises InputError where the rig's rest surface cannot be used."""
        self._rig = rig
        self._beams = Beams(rig)
        self._response = light_of_codes(rig.display)
        self._exponents = exponents(rig.display) if rig.display.response_exponent is not None else None
        self._pictures: dict[Handle, Bytes] = {}
        self._next_handle = 1
        self._beams_of = lru_cache(_KEPT_MIRRORS)(self._beams.all)

    def upload(self, image: Bytes) -> Handle:
        """Take over LCD grey codes (rows, cols); raises InputError for another shape or type."""
        expected = self._rig.display.rows, self._rig.display.columns
        if image.shape != expected or image.dtype != np.uint8:
            raise InputError(f"picture: shape {image.shape}, {image.dtype}: allowed {expected}, uint8")
        handle = self._next_handle
        self._next_handle += 1
        self._pictures[handle] = image.copy()
        return handle

    def release(self, handle: Handle) -> None:
        """Forget a picture."""
        del self._pictures[handle]

    def expose(self, pieces: Sequence[Piece]) -> Single:
        """Mean light (camera rows, cols); see `BenchRenderer.expose`."""
        by_mirror: dict[Mirror, Float] = {}
        for piece in pieces:
            light = self._panel_light(piece)
            earlier = by_mirror.get(piece.mirror)
            by_mirror[piece.mirror] = light if earlier is None else earlier + light
        display, camera = self._rig.display, self._rig.camera
        stripes = 3 if display.stripes == "rgb" else 1
        out = np.zeros((camera.rows, camera.columns))
        for mirror, light in by_mirror.items():
            for beam in self._beams_of(mirror):
                footprint = beam.q, beam.by_u, beam.by_v, beam.gain
                gather(light, *footprint, display.fill_factor, stripes, camera.psf_px, out)
        out += self._rig.simulation.ambient
        return out.astype(np.float32)

    def ray_map(self, mirror: Mirror) -> tuple[Single, Single]:
        """(q, reflectance) of the main beam at camera pixel centres."""
        q, gain, _ = self._beams.main(mirror)
        lost = np.isnan(q[..., 0])
        return q.astype(np.float32), np.where(lost, 0.0, gain).astype(np.float32)

    def close(self) -> None:
        """Forget all pictures and maps."""
        self._pictures.clear()
        self._beams_of.cache_clear()

    def _panel_light(self, piece: Piece) -> Float:
        light = np.zeros((self._rig.display.rows, self._rig.display.columns))
        for handle, share in piece.pictures:
            shown = self._response[self._pictures[handle]]
            light += share[:, None] * (shown if self._exponents is None else shown**self._exponents)
        return piece.weight * light
