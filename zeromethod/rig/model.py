"""The rig: a whole bench as a rig file describes it, with the tables of its devices.

`Rig.checked` is the one way from unchecked values to a rig: of files, edits (`Rig.replace`) and recordings.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import model_validator

from zeromethod.errors import InputError, check_type
from zeromethod.rig.device_tables import SIMULATED, CameraSpec, DisplaySpec, Noise, WatchSpec
from zeromethod.rig.geometry import GeometrySpec
from zeromethod.rig.interactive_tables import ClothSpec, ProjectorSpec
from zeromethod.rig.keys import plain, set_value, value_at
from zeromethod.rig.prism_tables import Layer, Prism, RestSurface
from zeromethod.rig.refusal import RENAMED, refused, shown, unknown_key, validated
from zeromethod.rig.simulation_tables import Faults, SimulationSpec
from zeromethod.rig.tables import (
    MARK_HALF_PX,
    ControlSpec,
    FaceSupports,
    KnownRest,
    LightSpec,
    PriorSpec,
    Rubber,
    SurfaceSpec,
    Table,
    TargetSpec,
    Text,
)

__all__ = [
    "MARK_HALF_PX",
    "SIMULATED",
    "CameraSpec",
    "ClothSpec",
    "ControlSpec",
    "DisplaySpec",
    "Faults",
    "GeometrySpec",
    "KnownRest",
    "Layer",
    "LightSpec",
    "Noise",
    "PriorSpec",
    "Prism",
    "ProjectorSpec",
    "RestSurface",
    "Rig",
    "Rubber",
    "SimulationSpec",
    "SurfaceSpec",
    "Table",
    "TargetSpec",
    "WatchSpec",
]  # fmt: skip

SCHEMA_VERSION = 2

REST_MAP_SUFFIXES = (".npz", ".h5")
"""Suffixes that a file with a rest map may have."""


class Rig(Table):
    """A whole bench. `scenario` names a packaged press scenario or a press file (`simulation.press_file`)."""

    schema_version: Literal[2]
    name: Text
    prism: Prism
    rubber: Rubber = Rubber()
    pattern_layers: tuple[Layer, ...] = ()
    camera_layers: tuple[Layer, ...] = ()
    display: DisplaySpec
    camera: CameraSpec
    watch: WatchSpec | None = None
    cloth: ClothSpec | None = None
    projector: ProjectorSpec | None = None
    target: TargetSpec = TargetSpec()
    light: LightSpec = LightSpec()
    control: ControlSpec = ControlSpec()
    surface: SurfaceSpec = SurfaceSpec()
    geometry: GeometrySpec = GeometrySpec()
    priors: PriorSpec = PriorSpec()
    simulation: SimulationSpec = SimulationSpec()
    scenario: Text = "default"

    @model_validator(mode="after")
    def _periods(self) -> Rig:
        smaller = min(self.camera.columns, self.camera.rows)
        if smaller < 4 * self.target.period_px:
            raise refused(
                "target.period_px", self.target.period_px, f"at most a quarter of {smaller} camera px"
            )
        return self

    @property
    def outlines_contacts(self) -> bool:
        """Whether contacts are outlined: neither under a lamp, whose light the mirror spreads, nor on a saw.

        Both look like the border of one.
        """
        return not self.light.by_mirror and self.prism.teeth is None

    @property
    def under_cloth(self) -> bool:
        """Whether a cloth lies on the mirror, through which fingers press: simulated, or of a projector."""
        return self.cloth is not None or self.projector is not None

    @property
    def rubs_unseen(self) -> str:
        """Why what rubs is not seen, "" where it is."""
        if self.under_cloth:
            return "under a cloth ([cloth] or [projector]), which hides what rubs"
        if not self.outlines_contacts:
            return "under a lamp or on a saw ([light] or [prism.teeth]), where contacts are not outlined"
        return (
            "in a passive run, in which nothing is lit white inside contacts" if self.control.passive else ""
        )

    @model_validator(mode="after")
    def _rubbed(self) -> Rig:
        if self.control.rubbing and (hidden := self.rubs_unseen):
            raise refused("control.rubbing", True, f"false {hidden}")
        return self

    @model_validator(mode="after")
    def _lit(self) -> Rig:
        if self.light.by_mirror and not self.control.passive:
            rule = 'only with control.controller "passive": a lamp lights a print, which cannot be warped'
            raise refused("light.source", self.light.source, rule)
        return self

    @model_validator(mode="after")
    def _sawn(self) -> Rig:
        if self.prism.teeth is None:
            return self
        if [layer.index for layer in self.pattern_layers] != [1.0]:
            found = [layer.index for layer in self.pattern_layers]
            raise refused(
                "pattern_layers", found, "with prism.teeth one layer of index 1: air under the tips"
            )
        if self.camera_layers:
            raise refused("camera_layers", len(self.camera_layers), "none with prism.teeth")
        if isinstance(self.rubber.support, FaceSupports):
            raise refused("rubber.support", {}, "no table with prism.teeth")
        for key in ("ghost_gap", "ghost_faces"):
            if share := getattr(self.simulation, key):
                raise refused(
                    f"simulation.{key}", share, "0 with prism.teeth: the way of rays has stray light"
                )
        return self

    @model_validator(mode="after")
    def _projected(self) -> Rig:
        simulated = self.projector is not None and self.projector.driver == SIMULATED
        if simulated and (self.cloth is None or self.display.driver != SIMULATED):
            rule = "'window' without a table [cloth], or with another display than the simulated one"
            raise refused("projector.driver", SIMULATED, rule)
        if self.cloth is not None and (self.camera.pupil_mm > 0 or self.prism.teeth is not None):
            raise refused("cloth", {}, "no table with camera.pupil_mm or prism.teeth: not simulated")
        if self.under_cloth and self.control.lamp:
            raise refused("control.lamp", True, "false under a cloth, whose threads the projector lights")
        return self

    @model_validator(mode="after")
    def _marks(self) -> Rig:
        last = self.camera.columns - 1, self.camera.rows - 1
        for k, place in enumerate(self.surface.marks_px):
            if not all(
                MARK_HALF_PX <= round(px) <= end - MARK_HALF_PX for px, end in zip(place, last, strict=True)
            ):
                allowed = f"{MARK_HALF_PX} px or more inside the image"
                raise refused(f"surface.marks_px[{k}]", list(place), allowed)
        return self

    @property
    def coded(self) -> bool:
        """Whether coded strips are asked for, by itself or because a device is not the simulated one."""
        if self.control.passive:
            return False
        if self.control.strips == "auto":
            return {self.camera.driver, self.display.driver} != {SIMULATED}
        return self.control.strips == "edges"

    def __repr__(self) -> str:
        camera, lcd, prism = self.camera, self.display, self.prism
        return (
            f"Rig({self.name!r}, camera {camera.columns}x{camera.rows} @ {camera.rate_hz:g} Hz, "
            f"LCD {lcd.columns}x{lcd.rows}, prism {prism.pattern_angle_deg:g}/{prism.camera_angle_deg:g} deg)"
        )

    @classmethod
    def checked(cls, data: dict[str, Any], where: str | Path, folder: Path, *, measured: bool = True) -> Rig:
        """Rig of a rig file's values.

        Parameters
        ----------
        data, where, folder : dict, str or Path, Path
            The values, as TOML has them; what messages begin with; where the files that it names lie.
        measured : bool
            With `camera.rest_map`.

        Returns
        -------
        Rig
            The checked rig.

        Raises
        ------
        InputError
            One line "where: key: value: what is allowed".
        """
        if refusal := _check_version(data) or _check_simulated_options(data):
            raise InputError(f"{where}: {refusal}")
        rig = validated(cls, data, where)
        if not measured:
            rig = rig.model_copy(update={"camera": rig.camera.model_copy(update={"rest_map": None})})
        try:
            return rig.model_copy(update=_files(rig, folder))
        except InputError as error:
            raise InputError(f"{where}: {error}") from None

    def replace(self, values: Mapping[str, Any] | None = None, /, **tables: Any) -> Rig:
        """Rig with other values, checked as a rig file is.

        Parameters
        ----------
        values : mapping, optional
            Values by dotted key: `{"display.pitch_mm": 0.06, "camera.focal_px[1]": 9000.0}`. None takes the
            key out, so that its default holds.
        **tables
            Keys of the top level: `scenario="step"`, `control=ControlSpec(gain=0.5)`.

        Returns
        -------
        Rig
            The changed rig; this one stays as it is.

        Raises
        ------
        InputError
            One line "rig: key: value: what is allowed", in the words of a rig file.
        """
        return replaced(self, {**(values or {}), **tables}, "rig")


def replaced(rig: Rig, values: Mapping[str, Any], where: str | Path, folder: Path = Path()) -> Rig:
    """`Rig.replace` for values from elsewhere; `where` and `folder` as in `Rig.checked`."""
    data = plain(rig)
    for key, value in values.items():
        try:
            set_value(data, key, value)
        except (KeyError, IndexError, TypeError, ValueError):
            raise InputError(f"{where}: {key}: {shown(value)}: a dotted key of a rig file") from None
    return Rig.checked(data, where, folder)


def _check_version(data: dict[str, Any]) -> str | None:
    version = data.get("schema_version")
    if type(version) is int and version == SCHEMA_VERSION:
        return None
    value = shown(version) if "schema_version" in data else "missing"
    old = [
        f"{key} to {new.rpartition('.')[2]}"
        for key, new in RENAMED.items()
        if value_at(data, key) is not None
    ]
    rename = f", after renaming {', '.join(old)}" if old else ""
    return f"schema_version: {value}: {SCHEMA_VERSION} is what this version of zeromethod reads{rename}"


def _check_simulated_options(data: dict[str, Any]) -> str | None:
    """Refuse keys that a lab's own driver could take but the simulated device does not."""
    for table, model in (("display", DisplaySpec), ("camera", CameraSpec)):
        given = data.get(table)
        if not isinstance(given, dict) or given.get("driver", SIMULATED) != SIMULATED:
            continue
        known = list(model.model_fields)
        for key in given:
            if key not in known:
                return unknown_key((table, key), known)
    return None


def _files(rig: Rig, folder: Path) -> dict[str, Any]:
    """Changes by which the files that a rig names are found from here; refuses missing files."""

    def found(key: str, name: str | Path, allowed: str, suffixes: tuple[str, ...] = ()) -> Path:
        file = folder / name
        if not file.is_file() or (suffixes and file.suffix not in suffixes):
            raise InputError(f"{key}: {shown(str(name))}: an existing {allowed}")
        return file

    update: dict[str, Any] = {}
    rest, rest_map = rig.prism.rest, rig.camera.rest_map
    if rest.file is not None:
        file = found("prism.rest.file", rest.file, ".npy file")
        update["prism"] = rig.prism.model_copy(update={"rest": rest.model_copy(update={"file": file})})
    if rest_map is not None:
        allowed = f"{' or '.join(REST_MAP_SUFFIXES)} file with a rest map"
        file = found("camera.rest_map", rest_map, allowed, REST_MAP_SUFFIXES)
        update["camera"] = rig.camera.model_copy(update={"rest_map": file})
    if rig.scenario.endswith(".toml"):
        update["scenario"] = str(found("scenario", rig.scenario, "press file or a packaged name"))
    return update


def check_rig(name: str, value: object) -> None:
    """Raise InputError for an argument that is no rig. name: of the function."""
    check_type(f"{name}: rig", value, Rig, "a Rig, as load_rig gives it")
