"""The rig file of LED and photodetector arrays: its tables and their rules."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from zeromethod.errors import InputError
from zeromethod.optics.prism import PrismGeometry
from zeromethod.resources import resource
from zeromethod.rig.load import LIGHT_ARRAY_TABLES, LIGHT_ARRAYS, RIG_FILE, rig_path
from zeromethod.rig.prism_tables import Prism
from zeromethod.rig.refusal import refused, validated
from zeromethod.rig.tables import Count, NotNegative, Positive, Rate, Share, Table, Text, Vector2
from zeromethod.toml_file import parse_toml, read_text

SIDE = 16
"""LEDs and detectors along each side of their arrays."""

Channels = tuple[Annotated[int, Field(ge=0, lt=SIDE * SIDE)], ...]
"""Numbers of LEDs or detectors: row * 16 + column; columns along the face, rows along y."""


class Leds(Table):
    """LEDs on the pattern face.

    pitch_mm: from LED to LED. centre_mm: of the array, from P0 along the face, and y. spot_mm: Gaussian sigma
    of one LED's light on the diffuser.
    """

    pitch_mm: Positive
    centre_mm: Vector2
    spot_mm: Positive

    @model_validator(mode="after")
    def _spots(self) -> Leds:
        if not 0.35 <= self.spot_mm / self.pitch_mm <= 0.8:
            rule = "0.35 to 0.8 of leds.pitch_mm: narrower spots leave gaps, wider ones cannot be levelled"
            raise refused("spot_mm", self.spot_mm, rule)
        return self


class Detectors(Table):
    """Photodetectors on the camera face, each behind a lens that looks along the face's normal.

    pitch_mm, centre_mm: as of the LEDs, on their own face. aperture_mm, acceptance_mrad: Gaussian sigmas of
    the place on the face and of the direction from which a detector takes in light. noise: standard deviation
    of one reading, of full scale.
    """

    pitch_mm: Positive
    centre_mm: Vector2
    aperture_mm: NotNegative
    acceptance_mrad: NotNegative
    rate_hz: Rate
    noise: Annotated[float, Field(ge=1e-5, le=0.05)]


class Pattern(Table):
    """Levels at rest: mean (1 + contrast (cos + cos)), crossed cosines with a period of whole LED pitches."""

    mean: Annotated[float, Field(gt=0, lt=1)]
    contrast: Annotated[float, Field(gt=0, le=0.6)]
    period_pitches: Annotated[int, Field(ge=3, le=8)]


class Control(Table):
    """gain: share of each correction of the levels that is applied."""

    gain: Annotated[float, Field(gt=0, le=1)] = 0.8


class Frame(Table):
    """Opening of the stiff frame that keeps the mirror's border at rest, in mm on the mirror: from, to."""

    x_mm: Vector2
    y_mm: Vector2


class Reading(Table):
    """How depth is read.

    modes: of how many modes it is the sum. dent_mm: Gaussian sigma of the narrowest dents expected. depth_mm:
    their rms depth.
    """

    modes: Annotated[int, Field(ge=6, le=100)]
    dent_mm: Positive
    depth_mm: Positive


class Arrays(Table):
    """Where the arrays are: "simulated", udp://HOST:PORT or serial:///dev/NAME.

    reopen_s: how long lost arrays are tried again.
    """

    address: Text = "simulated"
    reopen_s: Annotated[float, Field(ge=0, le=600)] = 10.0


class Simulation(Table):
    """The simulated arrays, and faults that begin `fault_s` after the scenario does.

    begin_s: when the scenario begins: the start is measured before. led_spread, detector_spread: standard
    deviation of their gains about 1. latency_frames: how many readings late levels are lit. drift_per_s:
    relative change of gain. ambient: light from outside, of full scale. brightness: of all LEDs, over rest.
    turned_mrad: by how much the detectors are truly turned about y against the rig file. lose_frames: numbers
    of readings that are lost. stall_at_frame, stall_s: from which reading on, and how long, none comes.
    """

    seed: Count = 0
    begin_s: NotNegative = 0.5
    led_spread: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    detector_spread: Annotated[float, Field(ge=0, le=0.2)] = 0.0
    latency_frames: Annotated[int, Field(ge=0, le=20)] = 1
    fault_s: float = 0.0
    dead_leds: Channels = ()
    dead_detectors: Channels = ()
    saturated_detectors: Channels = ()
    drifting_leds: Channels = ()
    drifting_detectors: Channels = ()
    drift_per_s: float = -0.05
    ambient: Share = 0.0
    brightness: Annotated[float, Field(gt=0, le=2)] = 1.0
    turned_mrad: float = 0.0
    lose_frames: tuple[Count, ...] = ()
    stall_at_frame: Count | None = None
    stall_s: NotNegative = 0.0


class LightArrayRig(Table):
    """A bench with arrays in place of LCD and camera, as its rig file describes it."""

    schema_version: Literal[2]
    name: Text
    prism: Prism
    frame: Frame
    leds: Leds
    detectors: Detectors
    pattern: Pattern
    control: Control = Control()
    reading: Reading
    arrays: Arrays = Arrays()
    simulation: Simulation = Simulation()
    scenario: Text = "default"

    @model_validator(mode="after")
    def _on_mirror(self) -> LightArrayRig:
        if self.prism.rest.shape != "flat":
            raise refused("prism.rest.shape", self.prism.rest.shape, "flat, with arrays")
        mirror = PrismGeometry(self.prism)
        half_mm = mirror.half_width_mm
        sides = ("x_mm", self.frame.x_mm, 0.0, mirror.length_mm), ("y_mm", self.frame.y_mm, -half_mm, half_mm)
        for key, (start, end), low, high in sides:
            if start < low or end > high or end - start < 5:
                rule = f"on the mirror, {low:g} to {high:g} mm: from, to, at least 5 mm apart"
                raise refused(f"frame.{key}", [start, end], rule)
        return self

    def changed(self, scenario: str | None = None, **tables: dict[str, Any]) -> LightArrayRig:
        """Rig with other values, checked: `changed(simulation={"seed": 1})`; None keeps the rig's own."""
        data = json.loads(self.model_dump_json(exclude_unset=True))
        for name, values in tables.items():
            given = {key: value for key, value in values.items() if value is not None}
            data[name] = data.get(name, {}) | given
        return validated(LightArrayRig, data | {"scenario": scenario or self.scenario}, "rig")


def load_light_array(name: str | Path) -> LightArrayRig | None:
    """Rig of arrays from a file, or the packaged "leds".

    None for a camera's rig, and for what is no rig file: `load_rig` refuses that. Raises InputError for the
    first wrong value.
    """
    packaged = str(name) in LIGHT_ARRAYS
    try:
        path = resource("calibration", "rigs", f"{name}.toml") if packaged else rig_path(name)
        data = parse_toml(read_text(path, RIG_FILE), path)
    except InputError:
        return None
    return validated(LightArrayRig, data, path) if LIGHT_ARRAY_TABLES & set(data) else None
