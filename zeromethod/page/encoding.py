"""A content's parts as viewers get them: JPEG pictures, maps of 16 bits; each made when first wanted."""

from __future__ import annotations

import json
import math
import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from zeromethod.page.message import Content, compact, content_part

PICTURE_COLUMNS = 640
"""Pictures wider than this are made smaller."""

QUALITY = 75
"""Of JPEG pictures: 60 kB for 640 x 512."""

_ALIGNED = 8
_MAPS = {
    "residual": {"length": (1.0, "camera px")},
    "surface": {"depth": (1e3, "µm")},
    "sigma": {"sigma": (1e3, "µm")},
    "place": {"x": (1.0, "mm"), "y": (1.0, "mm")},
    "fine": {"depth": (1e3, "µm")},
    "fine_sigma": {"sigma": (1e3, "µm")},
}
"""Maps of a part: their arrays, with what they are multiplied by, and the unit that they then have."""

_KINDS = ("not read", "measured", "cut off", "inside a contact", "dark")


def jpeg(image: NDArray[Any], bits: int = 8) -> bytes:
    """A grey picture, (rows, cols), made smaller where it is wide. bits: of its grey levels."""
    if image.dtype != np.uint8:
        image = np.right_shift(image, max(bits - 8, 0)).clip(0, 255).astype(np.uint8)
    if image.shape[1] > PICTURE_COLUMNS:
        size = PICTURE_COLUMNS, round(image.shape[0] * PICTURE_COLUMNS / image.shape[1])
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    good, encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not good:
        raise ValueError(f"a picture of {image.shape} {image.dtype} is no JPEG")
    return encoded.tobytes()


def run_lengths(values: NDArray[np.uint8]) -> list[int]:
    """[count, value, count, value, ...] of an array, row by row."""
    flat = values.ravel()
    starts = np.concatenate([[0], np.flatnonzero(np.diff(flat)) + 1])
    counts = np.diff(np.concatenate([starts, [flat.size]]))
    pairs: list[int] = np.stack([counts, flat[starts]], axis=1).ravel().tolist()
    return pairs


class Encoded:
    """One content, whose parts are encoded when they are first asked for."""

    def __init__(self, number: int, parts: frozenset[str], content: Content) -> None:
        """parts: those that were asked for, there or not."""
        self.number, self.parts, self.content = number, parts, content
        self._done: dict[str, tuple[dict[str, Any], bytes] | None] = {}

    def part(self, name: str) -> tuple[dict[str, Any], bytes] | None:
        """What is said of a part, and its bytes; None where it is not there."""
        if name not in self._done:
            self._done[name] = self._encode(name)
        return self._done[name]

    def _encode(self, name: str) -> tuple[dict[str, Any], bytes] | None:
        source = content_part(name)
        arrays, meta = self.content.arrays.get(source), self.content.meta.get(source, {})
        if arrays is None or name == "lcd":  # which is drawn elsewhere, and comes later
            return None
        if name in {"camera", "projected"}:
            rows, columns = arrays["image"].shape
            return meta | {"size": [columns, rows]}, jpeg(arrays["image"], meta.get("bits", 8))
        said = {} if name in {"sigma", "place"} else meta
        if name == "surface":
            said = said | {"kinds": run_lengths(arrays["kind"]), "kind_names": _KINDS}
        maps = _MAPS[name].items()
        return _maps(said, {key: (factor * arrays[key], unit) for key, (factor, unit) in maps})

    def probe(self, column: int, row: int) -> dict[str, Any] | None:
        """Figures of a node, exact; None where there is no surface or no such node."""
        arrays = self.content.arrays.get("surface")
        if arrays is None:
            return None
        rows, columns = arrays["depth"].shape
        if not (0 <= row < rows and 0 <= column < columns):
            return None

        def at(name: str, scale: float, *component: int) -> float | None:
            value = scale * float(arrays[name][(row, column, *component)])
            return value if math.isfinite(value) else None

        return {
            "node": [column, row],
            "time_s": self.content.meta["surface"].get("time_s"),
            "kind": _KINDS[int(arrays["kind"][row, column])],
            "depth_um": at("depth", 1e3),
            "sigma_um": at("sigma", 1e3),
            "slope_x_mrad": at("slope", 1e3, 0),
            "slope_y_mrad": at("slope", 1e3, 1),
            "x_mm": at("x", 1.0),
            "y_mm": at("y", 1.0),
        }


def _maps(
    said: dict[str, Any], maps: dict[str, tuple[NDArray[np.floating], str]]
) -> tuple[dict[str, Any], bytes]:
    """Maps of one shape, 16 bits a node."""
    data, about = [], {}
    for name, (values, unit) in maps.items():
        codes, offset, step = compact(values)
        about[name] = {"offset": offset, "step": step, "unit": unit}
        data.append(codes.astype("<u2").tobytes())
        said = said | {"shape": list(codes.shape)}
    return said | {"maps": about}, b"".join(data)


def packed(header: dict[str, Any], parts: dict[str, tuple[dict[str, Any], bytes]]) -> bytes:
    """One message: 4 bytes with the header's length, the header, then the parts, each at a multiple of 8."""
    described, data, start = {}, [], 0
    for name, (about, raw) in parts.items():
        described[name] = about | {"start": start, "length": len(raw)}
        gap = -len(raw) % _ALIGNED
        data += [raw, b"\0" * gap]
        start += len(raw) + gap
    text = json.dumps(header | {"parts": described}, allow_nan=False).encode()
    text += b" " * (-(len(text) + 4) % _ALIGNED)
    return b"".join((struct.pack("<I", len(text)), text, *data))
