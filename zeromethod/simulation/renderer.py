"""Protocol of the renderers that compute the simulated camera's light, in numpy or on the GPU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from zeromethod.arrays import Bytes, Float, Single
from zeromethod.errors import InputError
from zeromethod.rig.model import DisplaySpec, Rig
from zeromethod.simulation.press import Mirror

Handle = int
"""Names a picture of the renderer."""


@dataclass(slots=True)
class Piece:
    """One instant's worth of an exposure.

    weight: share of the exposure; the weights of all pieces add up to 1. mirror: where the rubber is.
    pictures: (handle, (lcd rows,) float32 share of the light that each LCD row gives of that picture);
    the shares add up to 1 in every row. Light, not codes, is mixed.
    """

    weight: float
    mirror: Mirror
    pictures: list[tuple[Handle, Single]]


@runtime_checkable
class BenchRenderer(Protocol):
    """Light at the camera's pixels, before noise."""

    def upload(self, image: Bytes) -> Handle:
        """Take over LCD grey codes (rows, cols)."""

    def release(self, handle: Handle) -> None:
        """Forget a picture."""

    def expose(self, pieces: Sequence[Piece], projected: Single | None = None) -> Single:
        """(camera rows, cols) float32: mean light, 1 = all of a fully lit LCD's light reflected.

        Includes LCD response and apertures (normalised by their fill: a white panel gives 1), reflectance,
        touch, ghosts, ambient light and the lens's blur, which acts on the image before the pixels sample it.
        Reflectance is taken at a pixel's centre: it alone is not blurred. The array may be reused by the next
        call. projected: a projector's luminance on the cloth (projector rows, cols), in all pieces.
        """

    def move(self, rig: Rig) -> None:
        """Have camera and LCD where `rig` has them."""

    def ray_map(self, mirror: Mirror) -> tuple[Single, Single]:
        """(q (rows, cols, 2) LCD px, NaN where no ray arrives; reflectance (rows, cols)) per camera pixel.

        Reflectance counts what touches; it is 0 where the ray is lost.
        """

    def close(self) -> None:
        """Free everything; safe to call twice."""


def by_mirror(pieces: Sequence[Piece]) -> dict[Mirror, dict[Handle, Float]]:
    """Mirror -> picture -> share (lcd rows,) of the light that each LCD row gives of it in all pieces."""
    result: dict[Mirror, dict[Handle, Float]] = {}
    for piece in pieces:
        shares = result.setdefault(piece.mirror, {})
        for handle, row_share in piece.pictures:
            shares[handle] = shares.get(handle, 0.0) + piece.weight * row_share.astype(np.float64)
    return result


def mirror_shares(pieces: Sequence[Piece]) -> dict[Mirror, float]:
    """Mirror -> its share of the exposure."""
    result: dict[Mirror, float] = {}
    for piece in pieces:
        result[piece.mirror] = result.get(piece.mirror, 0.0) + piece.weight
    return result


def check_picture(image: Bytes, display: DisplaySpec) -> None:
    """Raise InputError unless these are grey codes (rows, cols) of the whole LCD."""
    if image.shape != (display.rows, display.columns) or image.dtype != np.uint8:
        allowed = f"({display.rows}, {display.columns}) uint8"
        raise InputError(f"picture: {image.shape} {image.dtype}: allowed is {allowed}")
