"""What a calibration fits: a rig's geometry as named numbers, how well they are known, and back to a rig.

The camera's direction is given by two angles that do not depend on its position: `heading` turns its axis
in the world's xz plane, from x towards z, `elevation` lifts it towards y. The camera face is given by how
much its angle differs from the pattern face's: cut from one mould, they are known better against each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig
from zeromethod.rig.prism_tables import MOST_TEETH, Teeth


@dataclass(frozen=True, slots=True)
class Parameter:
    """One number of the bench's geometry.

    prior: key of the rig's `[priors]` that says how well the rig file knows it; "" = taken as exact unless
    another sigma is given. low, high: what is physically possible; a fit stays within.
    """

    name: str
    unit: str
    words: str
    prior: str = ""
    low: float = -np.inf
    high: float = np.inf

    def sigma(self, rig: Rig) -> float:
        """Standard deviation of the rig file's value, in the parameter's unit."""
        if not self.prior:
            return 0.0
        if self.name in _OF_TEETH and rig.prism.teeth is not None:
            tooth, key = _OF_TEETH[self.name]
            given: tuple[float, ...] = getattr(rig.prism.teeth, key.replace("_deviation_", "_sigma_"))
            if given:
                return given[tooth]
        sigma: float = getattr(rig.priors, self.prior)
        return 0.01 * sigma if self.prior.endswith("_percent") else sigma


_TOOTH = (
    ("base_mm", "mm", "the rubber above tooth {}, less all teeth's", "tooth_base_mm", "base_deviation_mm"),
    (
        "pattern_deg",
        "deg",
        "tooth {}'s face to the LCD, less all teeth's angle",
        "tooth_angle_deg",
        "pattern_deviation_deg",
    ),
    (
        "camera_deg",
        "deg",
        "tooth {}'s face to the camera, less all teeth's angle",
        "tooth_angle_deg",
        "camera_deviation_deg",
    ),
)
"""Of every tooth: name, unit, words, prior, key of the rig's teeth."""
_OF_TEETH = {f"tooth{k}.{one[0]}": (k, one[4]) for k in range(MOST_TEETH) for one in _TOOTH}
"""Tooth and key of every parameter of a tooth."""

PARAMETERS = {
    parameter.name: parameter
    for parameter in (
        Parameter(
            "display.along_mm", "mm", "the LCD's place along the pattern face from P0", "display_along_mm"
        ),
        Parameter("display.across_mm", "mm", "the LCD's place along y", "display_across_mm"),
        Parameter("display.turn_deg", "deg", "the LCD's turn in its plane", "display_turn_deg"),
        Parameter(
            "display.tilt_along_deg",
            "deg",
            "the LCD's wedge about the face's along direction",
            "display_wedge_deg",
        ),
        Parameter("display.tilt_y_deg", "deg", "the LCD's wedge about y", "display_wedge_deg"),
        Parameter("gap_mm", "mm", "the gap in front of the LCD", "gap_mm", low=0.0),
        Parameter("camera.x_mm", "mm", "the camera's x", "camera_place_mm"),
        Parameter("camera.y_mm", "mm", "the camera's y", "camera_place_mm"),
        Parameter("camera.z_mm", "mm", "the camera's z", "camera_place_mm"),
        Parameter("camera.heading_deg", "deg", "the camera's direction in the xz plane", "camera_aim_deg"),
        Parameter("camera.elevation_deg", "deg", "the camera's direction towards y", "camera_aim_deg"),
        Parameter("camera.roll_deg", "deg", "the camera's roll", "camera_roll_deg"),
        Parameter(
            "camera.scale",
            "",
            "the focal length (or pixel size) over the rig file's",
            "focal_percent",
            low=0.1,
        ),
        Parameter(
            "camera.aspect",
            "",
            "the focal length along v over the one along u",
            "focal_aspect_percent",
            low=0.5,
        ),
        Parameter("camera.centre_u_px", "px", "the principal point's column", "centre_px"),
        Parameter("camera.centre_v_px", "px", "the principal point's row", "centre_px"),
        Parameter("camera.k1", "", "the lens distortion k1", "distortion_k1"),
        Parameter("camera.k2", "", "the lens distortion k2"),
        Parameter("camera.p1", "", "the lens distortion p1"),
        Parameter("camera.p2", "", "the lens distortion p2"),
        Parameter("camera.k3", "", "the lens distortion k3"),
        Parameter("prism.index", "", "the rubber's index", "index", low=1.01, high=4.0),
        Parameter(
            "prism.pattern_angle_deg", "deg", "the pattern face's angle", "angle_deg", low=5.0, high=85.0
        ),
        Parameter(
            "prism.captured_less_pattern_deg", "deg", "the faces' difference in angle", "faces_difference_deg"
        ),
        Parameter(
            "prism.length_mm", "mm", "the prism's length (leg or mirror, as the rig file has it)", "length_mm"
        ),
        Parameter(
            "rest.scale",
            "",
            "the curved mirror's radius over the rig file's",
            "rest_radius_percent",
            low=0.1,
        ),
        Parameter("rest.x_mm", "mm", "the curved mirror's centre along x", "rest_centre_mm"),
        Parameter("rest.y_mm", "mm", "the curved mirror's centre along y", "rest_centre_mm"),
        Parameter("rest.axis_deg", "deg", "the direction of the mirror's cylinder", "rest_axis_deg"),
        Parameter("teeth.base_mm", "mm", "the rubber between mirror and valleys", "teeth_base_mm", low=0.0),
        *(
            Parameter(f"tooth{k}.{name}", unit, words.format(k), prior, low=-1.0, high=1.0)
            for k in range(MOST_TEETH)
            for name, unit, words, prior, _ in _TOOTH
        ),
    )
}
"""Every parameter by name, in the order of a vector. Scales are 1 in the rig file itself."""

_PLACES: dict[str, tuple[str, str, int | None]] = {
    "display.along_mm": ("display", "centre_mm", 0),
    "display.across_mm": ("display", "centre_mm", 1),
    "display.turn_deg": ("display", "turn_deg", None),
    "display.tilt_along_deg": ("display", "tilt_deg", 0),
    "display.tilt_y_deg": ("display", "tilt_deg", 1),
    "camera.x_mm": ("camera", "position_mm", 0),
    "camera.y_mm": ("camera", "position_mm", 1),
    "camera.z_mm": ("camera", "position_mm", 2),
    "camera.roll_deg": ("camera", "roll_deg", None),
    "camera.centre_u_px": ("camera", "centre_px", 0),
    "camera.centre_v_px": ("camera", "centre_px", 1),
    "prism.index": ("prism", "index", None),
    "prism.pattern_angle_deg": ("prism", "pattern_angle_deg", None),
    "camera.k1": ("camera", "distortion", 0),
    "camera.k2": ("camera", "distortion", 1),
    "camera.p1": ("camera", "distortion", 2),
    "camera.p2": ("camera", "distortion", 3),
    "camera.k3": ("camera", "distortion", 4),
}
"""Table, key and index of a rig where parameters stand as they are."""


def describe(rig: Rig) -> dict[str, float]:
    """Value of every parameter that the rig has."""
    camera, prism = rig.camera, rig.prism
    values: dict[str, float] = {}
    for name, (table, key, index) in _PLACES.items():
        value = getattr(getattr(rig, table), key)
        values[name] = value if index is None else value[index]
    axis = np.subtract(camera.look_at_mm, camera.position_mm)
    axis /= np.linalg.norm(axis)
    length_mm = prism.pattern_length_mm if prism.pattern_length_mm is not None else prism.mirror_length_mm
    assert length_mm is not None
    values |= {
        "camera.heading_deg": float(np.degrees(np.arctan2(axis[2], axis[0]))),
        "camera.elevation_deg": float(np.degrees(np.arcsin(axis[1]))),
        "camera.scale": 1.0,
        "prism.captured_less_pattern_deg": prism.camera_angle_deg - prism.pattern_angle_deg,
        "prism.length_mm": length_mm,
    }
    if rig.pattern_layers and rig.pattern_layers[-1].index == 1.0:
        values["gap_mm"] = rig.pattern_layers[-1].thickness_mm
    if prism.rest.radius_mm is not None:
        x_mm, y_mm = prism.rest.centre_mm
        values |= {"rest.scale": 1.0, "rest.x_mm": x_mm, "rest.y_mm": y_mm}
    if prism.rest.shape == "cylinder":
        values["rest.axis_deg"] = prism.rest.axis_deg
    if prism.teeth is not None:
        values["teeth.base_mm"] = prism.teeth.base_mm
        for name, (tooth, key) in _OF_TEETH.items():
            if tooth < prism.teeth.count:
                values[name] = (getattr(prism.teeth, key) or (0.0,) * prism.teeth.count)[tooth]
    lens = {name for name, place in _PLACES.items() if place[1] == "distortion"}
    if camera.projection == "perspective":
        assert camera.focal_px is not None
        lens, values["camera.aspect"] = set(), camera.focal_px[1] / camera.focal_px[0]
    return {name: values[name] for name in PARAMETERS if name in values and name not in lens}


def build(rig: Rig, values: Mapping[str, float]) -> Rig:
    """Rig with some of its parameters changed; scales are relative to `rig`. Values are not checked."""
    p = {**describe(rig), **values}
    tables: dict[str, dict[str, Any]] = {"display": {}, "camera": {}, "prism": {}}
    for name, (table, key, index) in _PLACES.items():
        if name in p and index is None:
            tables[table][key] = p[name]
        elif name in p:
            tables[table][key] = (*tables[table].get(key, ()), float(p[name]))
    camera, prism = tables["camera"], tables["prism"]
    heading, elevation = np.radians(p["camera.heading_deg"]), np.radians(p["camera.elevation_deg"])
    flat = np.cos(elevation)
    axis = np.array([flat * np.cos(heading), np.sin(elevation), flat * np.sin(heading)])
    reach = float(np.linalg.norm(np.subtract(rig.camera.look_at_mm, rig.camera.position_mm)))
    camera["look_at_mm"] = tuple(map(float, np.array(camera["position_mm"]) + reach * axis))
    if rig.camera.projection == "perspective":
        assert rig.camera.focal_px is not None
        focal = rig.camera.focal_px[0] * p["camera.scale"]
        camera["focal_px"] = (focal, focal * p["camera.aspect"])
    else:
        assert rig.camera.pixel_mm is not None
        camera["pixel_mm"] = rig.camera.pixel_mm * p["camera.scale"]
    prism["camera_angle_deg"] = p["prism.pattern_angle_deg"] + p["prism.captured_less_pattern_deg"]
    prism["pattern_length_mm" if rig.prism.pattern_length_mm is not None else "mirror_length_mm"] = p[
        "prism.length_mm"
    ]
    rest = rig.prism.rest
    if rest.radius_mm is not None:
        curved = {
            "radius_mm": rest.radius_mm * p["rest.scale"],
            "centre_mm": (p["rest.x_mm"], p["rest.y_mm"]),
            "axis_deg": p.get("rest.axis_deg", 0.0),
        }
        prism["rest"] = rest.model_copy(update=curved)
    if rig.prism.teeth is not None:
        prism["teeth"] = _teeth(rig.prism.teeth, p)
    changed: dict[str, Any] = {
        table: getattr(rig, table).model_copy(update=update) for table, update in tables.items()
    }
    if "gap_mm" in p:
        gap = rig.pattern_layers[-1].model_copy(update={"thickness_mm": p["gap_mm"]})
        changed["pattern_layers"] = (*rig.pattern_layers[:-1], gap)
    return rig.model_copy(update=changed)


def _teeth(teeth: Teeth, p: Mapping[str, float]) -> Teeth:
    """Teeth with the parameters `p`."""
    update: dict[str, Any] = {"base_mm": p["teeth.base_mm"]}
    for name, _, _, _, key in _TOOTH:
        values = tuple(float(p[f"tooth{k}.{name}"]) for k in range(teeth.count))
        update[key] = values if any(values) else ()
    return teeth.model_copy(update=update)


@dataclass(frozen=True)
class Priors:
    """What is believed of a rig before any data: the free parameters' values and standard deviations.

    A vector of a fit is z = (value - mean) / sigma: in these units every prior is 1 wide, whatever its unit.
    """

    rig: Rig
    names: tuple[str, ...]
    mean: Float
    sigma: Float

    @classmethod
    def of(cls, rig: Rig, sigma: Mapping[str, float] | None = None) -> Priors:
        """Priors of the rig file, with other standard deviations where given; 0 takes a value as exact.

        Raises InputError for a name that the rig does not have, or a sigma that is negative or not finite.
        """
        values, given = describe(rig), dict(sigma or {})
        for name, value in given.items():
            if name not in values:
                raise InputError(f"prior: {name}: not a parameter of this rig: one of {', '.join(values)}")
            if not (np.isfinite(value) and value >= 0.0):
                raise InputError(f"prior: {name}: {value}: a number from 0 up")
        widths = {name: given.get(name, PARAMETERS[name].sigma(rig)) for name in values}
        names = tuple(name for name, width in widths.items() if width > 0.0)
        mean = np.array([values[name] for name in names])
        return cls(rig, names, mean, np.array([widths[name] for name in names]))

    def values(self, z: Float) -> dict[str, float]:
        """Free parameters' values at z (n,)."""
        return dict(zip(self.names, map(float, self.mean + self.sigma * z), strict=True))

    def at(self, z: Float) -> Rig:
        """Rig at z (n,)."""
        return build(self.rig, self.values(z))

    def within(self, z: Float) -> Float:
        """Vector z (n,) brought back within what is physically possible."""
        low = np.array([PARAMETERS[name].low for name in self.names])
        high = np.array([PARAMETERS[name].high for name in self.names])
        return np.asarray(np.clip(z, (low - self.mean) / self.sigma, (high - self.mean) / self.sigma))
