"""What a person knows of the bench, as options of `zeromethod calibrate`: read, checked against the rig."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from pydantic import ValidationError

from zeromethod.calibration import Direct, Intrinsics, MirrorEdge
from zeromethod.calibration.camera_file import CameraFile
from zeromethod.calibration.parameters import PARAMETERS, build
from zeromethod.commissioning.calibration.plan import Known
from zeromethod.errors import InputError
from zeromethod.rig.model import Rig
from zeromethod.rig.refusal import first_refusal

EDGE_PX = 2.0
"""How well an edge is seen, camera px, unless given."""

DEEPEST_SHARE = 0.1
"""Deepest press that is asked for, of the prism's length: far beyond what a loop follows."""


def numbers_of(option: str, text: str, words: str = "numbers") -> tuple[float, ...]:
    """Numbers of "0.2,0.15"; none of "". Raises InputError."""
    try:
        return tuple(float(part) for part in text.split(",")) if text.strip() else ()
    except ValueError:
        raise InputError(f"{option}: {text}: {words} with commas between them") from None


def known_of(text: str) -> Direct:
    """Parameter, value and sigma of "gap_mm=0.48:0.01". Raises InputError."""
    name, _, numbers = text.partition("=")
    value, _, sigma = numbers.partition(":")
    try:
        one = Direct(name.strip(), float(value), float(sigma))
    except ValueError as error:
        words = str(error) if isinstance(error, InputError) else "NAME=VALUE:SIGMA, as gap_mm=0.48:0.01"
        raise InputError(f"--known: {text}: {words}") from None
    if not (math.isfinite(one.value) and math.isfinite(one.sigma_value)):
        raise InputError(f"--known: {text}: VALUE and SIGMA must be finite numbers")
    return one


def ball_of(text: str) -> tuple[float, float]:
    """Radius and sigma, mm, of "800:4". Raises InputError."""
    radius, _, sigma = text.partition(":")
    try:
        return float(radius), float(sigma)
    except ValueError:
        raise InputError(f"--press-ball: {text}: RADIUS:SIGMA in mm, as 10:0.01") from None


def edge_of(text: str) -> MirrorEdge:
    """A point of an edge, camera px, of "R0=1180.5,512:2". Raises InputError."""
    name, _, rest = text.partition("=")
    place, _, sigma = rest.partition(":")
    try:
        u, v = (float(part) for part in place.split(","))
        spread = float(sigma or EDGE_PX)
    except ValueError:
        u = v = spread = math.nan
    name = name.strip()
    if name not in ("P0", "R0") or not (math.isfinite(u + v + spread) and spread > 0):
        raise InputError(
            f"--edge-point: {text}: P0=U,V[:SIGMA] or R0=U,V[:SIGMA] in camera px, as R0=1180.5,512:2"
        )
    return MirrorEdge("P0" if name == "P0" else "R0", np.array([[u, v]]), spread)


def check_known(rig: Rig, known: Sequence[Known], lens: CameraFile | None) -> None:
    """Refuse, with InputError, what cannot be of this rig, before anything is opened."""
    columns, rows = rig.camera.columns, rig.camera.rows
    if lens is not None:
        lens.check(rig)
    for one in known:
        if isinstance(one, MirrorEdge):
            u, v = one.pixel[0]
            if not (-0.5 <= u <= columns - 0.5 and -0.5 <= v <= rows - 0.5):
                raise InputError(
                    f"--edge-point: {one.edge}={u:g},{v:g}: a point of the image, {columns} x {rows} px"
                )
        elif isinstance(one, Intrinsics):
            one.prepared(rig)
        else:
            _check_direct(rig, one)


def check_depths(rig: Rig, depths_mm: Sequence[float], option: str = "--press-depths") -> None:
    """Refuse, with InputError, presses deeper than a rubber of this size takes."""
    prism = rig.prism
    name = "leg" if prism.pattern_length_mm is not None else "mirror"
    length_mm = prism.pattern_length_mm if prism.pattern_length_mm is not None else prism.mirror_length_mm
    assert length_mm is not None
    deepest_mm = DEEPEST_SHARE * length_mm
    for depth_mm in depths_mm:
        if depth_mm > deepest_mm:
            raise InputError(
                f"{option}: {depth_mm:g}: depths in mm, at most {deepest_mm:g} "
                f"(a tenth of the prism's {name} of {length_mm:g} mm)"
            )


def _check_direct(rig: Rig, one: Direct) -> None:
    """A value that the rig file itself would not take is none that was measured."""
    try:
        one.prepared(rig)
    except InputError as error:
        raise InputError(f"--known: {error}") from None
    given, limits = f"--known: {one.parameter}={one.value:g}", PARAMETERS[one.parameter]
    if not limits.low <= one.value <= limits.high:
        bounds = [f"at least {limits.low:g}"] if math.isfinite(limits.low) else []
        bounds += [f"at most {limits.high:g}"] if math.isfinite(limits.high) else []
        raise InputError(f"{given}: a number {' and '.join(bounds)}")
    try:
        Rig.model_validate(build(rig, {one.parameter: one.value}).model_dump(exclude_unset=True))
    except ValidationError as error:
        raise InputError(f"{given}: as the rig file has it: {first_refusal(error, Rig)}") from None
