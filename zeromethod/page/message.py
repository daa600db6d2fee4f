"""What goes from the run's process to the server's, and back.

To the server, by an `ArrayExchange`: a tuple (kind, value), of which `CONTENT` may carry arrays.
From the server: lines of JSON, an object each, by its member "kind".
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from zeromethod.errors import InputError

SETTING, CONTENT, SAID, ANSWER, DRAWING = "setting", "content", "said", "answer", "drawing"
"""To the server: `Setting`, first of all; (parts, `Content`); a `Said`; (number of a call, answer, error);
(rig, rest), of which the LCD's picture is drawn."""

READY, REFUSED, ASK, CALL, NEWS = "ready", "refused", "ask", "call", "news"
"""From the server: it serves (addresses); why it cannot; parts wanted next; a call; words for people."""

PARTS = ("camera", "lcd", "projected", "residual", "surface", "sigma", "place", "fine", "fine_sigma")
"""Parts that a viewer may ask for, apart from values: pictures of camera and LCD, maps of residual with mask,
of depth, of its sigma, and of where on the mirror the nodes are, which three come of one content's part
"surface"; depth on every pixel and its sigma, of the part "fine"."""

_SOURCES = {"sigma": "surface", "place": "surface", "fine_sigma": "fine"}

STAGES = ("exposed", "stepped", "composed", "received", "packed")
"""Mid-exposure; once round the loop; taken for the page; in the server; packed for a viewer."""


@dataclass(frozen=True, slots=True)
class Setting:
    """What a server is to serve, and to whom.

    table: `Table.described`. columns: of the history's rows. host, port: of the page; None: no page.
    control: (host, port), or a path for a Unix socket; None for none. tokens: (control, viewing only).
    """

    table: dict[str, Any]
    columns: tuple[str, ...]
    host: str
    port: int | None
    control: tuple[str, int] | str | None
    tokens: tuple[str, str]


@dataclass(frozen=True, slots=True)
class Said:
    """Something that happened. kind: note, state, call. time_s: of the run, None where it has none."""

    kind: str
    words: str
    time_s: float | None = None


@dataclass(frozen=True, slots=True)
class Content:
    """The newest of a run. stages: when what happened to its picture, `STAGES`, by the host's clock, unix ms.

    arrays: by part and name. meta: by part, plain values that go with its arrays.
    """

    values: dict[str, Any]
    rows: list[tuple[Any, ...]] = field(default_factory=list)
    stages: dict[str, float] = field(default_factory=dict)
    arrays: dict[str, dict[str, NDArray[Any]]] = field(default_factory=dict)
    meta: dict[str, dict[str, Any]] = field(default_factory=dict)


def asked_of(text: bytes | str) -> dict[str, Any]:
    """Object that a client asks by. Raises InputError, one line, for what is none, or cannot be sent on."""
    try:
        asked = json.loads(text if isinstance(text, str) else text.decode())
        # neither what JSON has not (NaN) nor halves of characters ("\\ud800")
        json.dumps(asked, allow_nan=False, ensure_ascii=False).encode()
    except RecursionError:
        raise InputError("not JSON: objects or lists too deep inside each other") from None
    except (UnicodeDecodeError, UnicodeEncodeError) as error:
        raise InputError(f"not UTF-8: {error.reason}") from None
    except ValueError:
        raise InputError("not JSON: one object is wanted") from None
    if not isinstance(asked, dict):
        raise InputError("an object is wanted")
    return asked


def unix_ms() -> float:
    """The host's clock, unix ms."""
    return 1e-6 * time.time_ns()


def content_parts(parts: frozenset[str]) -> frozenset[str]:
    """Parts of a content that the parts for a viewer are made from."""
    return frozenset(map(content_part, parts))


def content_part(part: str) -> str:
    """Part of a content that a part for a viewer is made from."""
    return _SOURCES.get(part, part)


def compact(values: NDArray[np.floating]) -> tuple[NDArray[np.uint16], float, float]:
    """(codes, offset, step) of a map: value = offset + step * code, 65535 for what is not a number."""
    finite = np.isfinite(values)
    if not finite.any():
        return np.full(values.shape, 65535, np.uint16), 0.0, 1.0
    known = values[finite]
    low, high = float(known.min()), float(known.max())
    step = (high - low) / 65534 or 1.0
    codes = np.full(values.shape, 65535, np.uint16)
    codes[finite] = np.rint((known - low) / step).astype(np.uint16)
    return codes, low, step
