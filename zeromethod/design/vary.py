"""One number of a rig file changed step by step: what becomes of the bench's figures."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.design.figures import headline
from zeromethod.design.sampled_view import SampledView
from zeromethod.errors import InputError
from zeromethod.optics import check_geometry
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.keys import value_at
from zeromethod.rig.model import Rig

STEPS = 16
MOST_STEPS = 200

_PATTERN = re.compile(r"(?P<key>[^=]+)=(?P<low>[^:=]+):(?P<high>[^:=]+)(:(?P<steps>[^:=]+))?")


@dataclass(frozen=True)
class Variation:
    """Which number runs from where to where. `key`: a word of NAMES or a dotted key of the rig file."""

    key: str
    low: float
    high: float
    steps: int

    @classmethod
    def parse(cls, text: str) -> Variation:
        """Variation of "angle=45:60" or "index=1.38:1.44:13"; InputError, one line, where it is none."""
        found = _PATTERN.fullmatch(text.strip())
        try:
            if found is None:
                raise ValueError
            low, high = float(found["low"]), float(found["high"])
            steps = STEPS if found["steps"] is None else int(found["steps"])
        except ValueError:
            allowed = "KEY=FROM:TO or KEY=FROM:TO:STEPS, such as angle=45:60"
            raise InputError(f"--vary: {text!r}: {allowed}") from None
        if not (np.isfinite([low, high]).all() and low != high and 2 <= steps <= MOST_STEPS):
            raise InputError(f"--vary: {text!r}: two different numbers and 2 to {MOST_STEPS} steps")
        return cls(found["key"].strip(), low, high, steps)

    @property
    def values(self) -> list[float]:
        """The numbers tried."""
        return [float(value) for value in np.linspace(self.low, self.high, self.steps)]

    @property
    def label(self) -> str:
        """Name with its unit, for an axis."""
        return NAMES[self.key][0] if self.key in NAMES else self.key


def varied(rig: Rig, key: str, value: float) -> Rig:
    """Rig with one number changed. Raises InputError (one line) for a key or value that is not allowed.

    A dotted key of the rig file ("display.pitch_mm", "pattern_layers[0].index", "camera.focal_px[1]") changes
    that number alone, whatever follows from it in the lab; the words of NAMES say what goes along.
    """
    if key in NAMES:
        return NAMES[key][1](rig, value)
    if isinstance(value_at(rig.model_dump(), key), int):
        value = round(value)
    return rig.replace({key: value})


def curves(
    rig: Rig, variation: Variation, pupil_mm: float, on_step: Callable[[], object] = lambda: None
) -> dict[str, Any]:
    """Headline figures at every value: {"key", "values", one list per figure, "refused": {value: reason}}.

    A value with which the bench cannot work has None in every list and its reason under "refused". Raises
    InputError where the key is wrong or no value works.
    """
    _check_key(rig, variation)
    found: list[dict[str, float] | None] = []
    refused: dict[str, str] = {}
    for value in variation.values:
        try:
            changed = varied(rig, variation.key, value)
            check_geometry(changed)
            found.append(headline(SampledView(changed), pupil_mm))
        except InputError as error:
            found.append(None)
            refused[f"{value:g}"] = str(error)
        on_step()
    first = next((figures for figures in found if figures is not None), None)
    if first is None:
        raise InputError(
            f"--vary: {variation.key}: no value works; the first: {next(iter(refused.values()))}"
        )
    columns = {name: [None if figures is None else figures[name] for figures in found] for name in first}
    return {"key": variation.key, "values": variation.values, **columns, "refused": refused}


def smallest_total_angle(rig: Rig, highest_deg: float = 75.0) -> float | None:
    """Least angle of both faces, deg, to 0.05, at which the whole view is beyond the critical angle.

    The camera goes along as `varied` has it for "angle". None where no angle up to `highest_deg` does.
    """
    low = rig.prism.pattern_angle_deg

    def total(angle_deg: float) -> bool:
        try:
            view = SampledView(varied(rig, "angle", angle_deg))
        except InputError:
            return False
        return bool((view.trace.reflectance[view.on_lcd] >= 1.0).all())

    high = next((angle for angle in np.arange(np.ceil(low), highest_deg + 0.5, 1.0) if total(angle)), None)
    if high is None:
        return None
    low = max(low, high - 1.0)
    while high - low > 0.05:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if total(middle) else (middle, high)
    return float(high)


def _check_key(rig: Rig, variation: Variation) -> None:
    if variation.key in NAMES:
        return
    value = value_at(rig.model_dump(), variation.key)
    if isinstance(value, bool) or not isinstance(value, int | float):
        words = ", ".join(NAMES)
        raise InputError(
            f"--vary: {variation.key!r}: {words}, or a number of the rig file by its dotted key "
            "(prism.pattern_length_mm, pattern_layers[0].thickness_mm)"
        )
    if isinstance(value, int) and any(number != round(number) for number in variation.values):
        raise InputError(f"--vary: {variation.key!r}: a whole number: choose the steps so that each is")


def _with_angle(rig: Rig, angle_deg: float) -> Rig:
    """Both faces at one angle; the camera keeps its place before the camera face.

    It looks at the same share of the mirror's length, at the same angle to the camera face, through the
    same length of air. The LCD goes with its face.
    """
    changed = rig.replace({"prism.pattern_angle_deg": angle_deg, "prism.camera_angle_deg": angle_deg})
    before, after = PrismGeometry(rig.prism), PrismGeometry(changed.prism)
    turn = np.radians(angle_deg - rig.prism.camera_angle_deg)
    # the camera face's normal (sin b, 0, -cos b) turns from -z towards x as b grows
    rotation = np.array([[np.cos(turn), 0, -np.sin(turn)], [0, 1, 0], [np.sin(turn), 0, np.cos(turn)]])
    look_at = np.array(rig.camera.look_at_mm)
    away = np.array(rig.camera.position_mm) - look_at
    direction = away / np.linalg.norm(away)
    air_mm = np.linalg.norm(away) - _inside_mm(before, look_at, direction)
    stretch = np.array([after.length_mm / before.length_mm, 1.0, 1.0])
    new_look_at, new_direction = stretch * look_at, rotation @ direction
    position = new_look_at + (_inside_mm(after, new_look_at, new_direction) + air_mm) * new_direction
    return _with_camera(changed, position, new_look_at)


def _inside_mm(prism: PrismGeometry, look_at: np.ndarray, direction: np.ndarray) -> float:
    """Length, along the optical axis, from the point looked at to the camera face's plane."""
    face = prism.camera_face
    return float(face.depth_below(look_at)) / float(direction @ face.normal)


def _with_distance(rig: Rig, distance_mm: float) -> Rig:
    position, look_at = np.array(rig.camera.position_mm), np.array(rig.camera.look_at_mm)
    away = (position - look_at) / np.linalg.norm(position - look_at)
    return _with_camera(rig, look_at + distance_mm * away, look_at)


def _with_camera(rig: Rig, position: np.ndarray, look_at: np.ndarray) -> Rig:
    return rig.replace({"camera.position_mm": position, "camera.look_at_mm": look_at})


def _with_gap(rig: Rig, gap_mm: float) -> Rig:
    if not rig.pattern_layers:
        raise InputError("--vary: gap: the rig has no pattern_layers, the last of which is the gap")
    return rig.replace({f"pattern_layers[{len(rig.pattern_layers) - 1}].thickness_mm": gap_mm})


def _with_focal(rig: Rig, focal_px: float) -> Rig:
    if rig.camera.focal_px is None:
        raise InputError("--vary: focal: an orthographic camera has no focal length")
    ratio = rig.camera.focal_px[1] / rig.camera.focal_px[0]
    return rig.replace({"camera.focal_px[0]": focal_px, "camera.focal_px[1]": focal_px * ratio})


NAMES: dict[str, tuple[str, Callable[[Rig, float], Rig]]] = {
    "angle": ("angle of both faces, deg", _with_angle),
    "index": ("index of the rubber", lambda rig, value: rig.replace({"prism.index": value})),
    "gap": ("gap before the LCD, mm", _with_gap),
    "distance": ("camera to the point looked at, mm", _with_distance),
    "focal": ("focal length, camera px", _with_focal),
}
"""Numbers that go by a word: label, and how a rig is given another value. angle: of both faces, the camera
going along; gap: the last pattern layer; distance: of the camera along its axis; focal: both axes."""
