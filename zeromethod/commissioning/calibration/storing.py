"""A calibration as a folder on disk, and what was recorded back from one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.calibration.edges import EdgeSearch
from zeromethod.calibration.fitting import Fit
from zeromethod.calibration.folder import ARRAYS, GIVEN, Stored, load, load_arrays, store
from zeromethod.calibration.measurements import Direct, Intrinsics, MirrorEdge
from zeromethod.calibration.parameters import PARAMETERS, describe
from zeromethod.calibration.shortfall import Lack, Part, Shortfall
from zeromethod.commissioning.calibration.evaluation import Calibration
from zeromethod.commissioning.calibration.plan import Known, Plan, Recorded
from zeromethod.commissioning.calibration.presses import PressWarps
from zeromethod.commissioning.calibration.projector import Projection
from zeromethod.commissioning.calibration.rest import RestFrames
from zeromethod.commissioning.calibration.settling import Settling
from zeromethod.commissioning.decode import figures
from zeromethod.decoding.fringes import Axis, FringeSequence
from zeromethod.errors import InputError, check_type
from zeromethod.rig.load import load_rig
from zeromethod.warp.warp import Warp

_OFFERS = 6
_DELAY = (
    "latency_s",
    "sigma_s",
    "jitter_s",
    "refresh_hz",
    "camera_rate_hz",
    "horizon_s",
    "frames",
    "used",
    "range_s",
)
_DATA = ("name=measurement.name", "numbers=count", "outliers")
_WARP = ("q", "sigma", "flags")
_SEQUENCE = ("periods_px", "shifts_rad", "axes", "repeats")
_ARRAYS = (
    *(f"rest_map/{name}=rest.rest_map.{name}" for name in ("lcd_px", "valid", "reason")),
    *(f"raw/{name}=recorded.rest.{name}" for name in ("sums", "frames")),
    *(f"raw/{name}=recorded.rest.sequence.{name}" for name in _SEQUENCE),
    "fit/names=fitted.priors.names",
    "fit/prior_mean=fitted.priors.mean",
    "fit/prior_sigma=fitted.priors.sigma",
    "fit/z=fitted.z",
    "fit/covariance=fitted.covariance",
    "depth_error/sensitivity=error.sensitivity",
    "depth_error/place=error.place",
)
_LIGHT_ARRAYS = (
    "light/codes=response.codes",
    "light/light=response.whole.light",
    "light/sigma=response.whole.sigma",
    "light/lit=lit",
    "light/bad_pixels=bad_pixels",
)
_LIGHT = (
    "gamma=response.whole.gamma",
    "gamma_sigma=response.whole.gamma_sigma",
    "power_law_misfit=response.whole.misfit",
    "read_grey=noise.read_grey",
    "electrons_per_grey=noise.electrons_per_grey",
    "black_grey=noise.black.grey",
    "black_sigma_grey=noise.black.sigma",
    "darkest_share=falloff.darkest",
    "advice",
)
_PROJECTION = tuple(f"projector/{name}" for name in Projection._fields)
_KEPT = ("light", "delay", "panel")
"""Tables of a document that evaluating again does not change."""


def store_calibration(
    found: Calibration,
    name: str | Path,
    *,
    settings: Mapping[str, Any] | None = None,
    pictures: Mapping[str, Callable[[Path], object]] | None = None,
    home: Path | None = None,
    again: Stored | None = None,
) -> Stored:
    """Write a calibration into a dated folder, with a rig file that a session takes.

    Parameters
    ----------
    found : Calibration
        What `calibrate` gave.
    name : str or Path
        The rig file that it is of, or a packaged name.
    settings : mapping, optional
        Keys of the rig file as they were used, not found.
    pictures : mapping, optional
        File names, and what draws each.
    home : Path, optional
        Where the dated folder is made; calibrations/NAME next to the rig file by default.
    again : Stored, optional
        The calibration whose records were evaluated again.

    Returns
    -------
    Stored
        The folder; its `rig_file` is what `Session` takes.
    """
    check_type("store_calibration: found", found, Calibration, "a Calibration, as calibrate gives it")
    document = document_of(found)
    if again is not None:
        kept = {key: again.document[key] for key in _KEPT if key in again.document}
        document |= {**kept, "redone_from": again.folder.name}
    values = found.values | {"geometry.date": document["time"].isoformat()}
    return store(name, document, values, arrays_of(found), settings=settings, pictures=pictures, home=home)


def recall(folder: Path) -> tuple[Recorded, Stored]:
    """What was recorded for a calibration, to evaluate it again. Raises InputError."""
    stored = load(folder)
    raw = stored.document["recorded"]
    names = (*_SEQUENCE, "frames", "sums")
    arrays = load_arrays(folder)
    if missing := [f"raw/{name}" for name in names if f"raw/{name}" not in arrays]:
        raise InputError(f"{folder / ARRAYS}: {missing[0]}: missing: arrays of a calibration")
    periods, shifts, axes, repeats, frames, sums = (arrays[f"raw/{name}"] for name in names)
    axes_given: tuple[Axis, Axis] = ("columns", "rows") if str(axes[0]) == "columns" else ("rows", "columns")
    sequence = FringeSequence(tuple(map(float, periods)), tuple(map(float, shifts)), axes_given, int(repeats))
    presses = None
    if "presses/rest_q" in arrays:
        stacks = (arrays.get(f"presses/pressed_{part}", ()) for part in _WARP)
        pressed = tuple(Warp(q, sigma, flags, 0) for q, sigma, flags in zip(*stacks, strict=True))
        ball = _warp_of(arrays, "ball") if "presses/ball_q" in arrays else None
        presses = PressWarps(_warp_of(arrays, "rest"), pressed, ball)
    plan = Plan(
        press_depths_mm=tuple(raw.get("press_depths_mm", ())),
        press_sigma_mm=raw["press_sigma_mm"],
        ball_mm=(raw["ball"]["radius_mm"], raw["ball"]["sigma_mm"]) if "ball" in raw else None,
        edges=raw.get("edges", True),
        known=tuple(map(_known_of, raw.get("known", ()))),
        rest_frames=int(frames),
    )
    recorded = Recorded(
        load_rig(folder / GIVEN),
        plan,
        stored.fingerprint,
        Settling(**stored.document["settling"]),
        RestFrames(sequence, sums, int(frames)),
        presses=presses,
        projection=Projection(*(arrays[name] for name in _PROJECTION)) if _PROJECTION[0] in arrays else None,
        shortfalls=tuple(map(_shortfall_of, stored.document.get("shortfall", ()))),
        values=_values_of(raw.get("values", {})),
        notes=tuple(raw.get("notes", ())),
    )
    return recorded, stored


def _table(one: object, *fields: str) -> dict[str, Any]:
    """Fields of an object, by name, or as "key=path" under another key."""
    pairs = [field.partition("=") for field in fields]
    return {key: attrgetter(path or key)(one) for key, _, path in pairs}


def arrays_of(found: Calibration) -> dict[str, Any]:
    """Arrays of a calibration by name."""
    arrays = _table(found, *_ARRAYS)
    arrays["rest_map/sigma_px"] = found.rest.rest_map.sigma_px.astype(np.float32)
    if (presses := found.recorded.presses) is not None:
        for part in _WARP:
            of = attrgetter(part)
            arrays[f"presses/rest_{part}"] = of(presses.rest)
            if presses.pressed:
                arrays[f"presses/pressed_{part}"] = np.stack([of(warp) for warp in presses.pressed])
            if presses.ball is not None:
                arrays[f"presses/ball_{part}"] = of(presses.ball)
    if (seen := found.recorded.projection) is not None:
        arrays |= {f"projector/{name}": places for name, places in seen._asdict().items()}
    if (light := found.recorded.light) is not None:
        arrays |= _table(light, *_LIGHT_ARRAYS)
        arrays["light/falloff"] = light.falloff.smooth.astype(np.float32)
    return arrays


def document_of(found: Calibration) -> dict[str, Any]:
    """calibration.toml of a calibration, as plain values."""
    recorded, fitted, error, plan = found.recorded, found.fitted, found.error, found.recorded.plan
    numbers = error.x_mm, error.y_mm, error.percent, *error.place_mm
    regions = zip(error.names, *numbers, strict=True)
    columns = ("name", "x_mm", "y_mm", "percent", "sigma_x_mm", "sigma_y_mm")
    document: dict[str, Any] = {
        "time": datetime.now(UTC).replace(microsecond=0),
        "rig": recorded.rig.name,
        "made_by": f"zeromethod {version('zeromethod')}",
        "verdict": _table(found.verdict, "level=level.value", "reason", "findings"),
        "depth_error": {
            "percent": found.depth_percent,
            "worst_percent": error.percent.max(),
            "region": [dict(zip(columns, one, strict=True)) for one in regions],
        },
        "parameters": _parameters(fitted),
        "fit": _table(fitted, "chi2_per_freedom", "rest_map_sigma_factor=inflation", "settled")
        | {"data": [_table(one, *_DATA) for one in fitted.terms]},
        "not_told_apart": [_table(one, "words", "kept", "depth_percent") for one in found.open_blends],
        "measure_next": [_table(one, "what", "depth_percent=percent") for one in found.gains[:_OFFERS]],
        "edge": [_edge(one) for one in found.edges],
        "rest_map": figures(found.rest),
        "settling": asdict(recorded.settling),
        "shortfall": [asdict(one) for one in recorded.shortfalls],
    }
    if found.carrier is not None:
        document["carrier"] = found.carrier
    if found.projector:
        document["projector"] = {key.partition(".")[2]: one for key, one in found.projector.items()}
    if recorded.delay is not None:
        document["delay"] = _table(recorded.delay, *_DELAY)
    if recorded.panel is not None:
        document["panel"] = asdict(recorded.panel)
    if (light := recorded.light) is not None:
        document["light"] = _table(light, *_LIGHT) | {
            "bad_pixels": np.count_nonzero(light.bad_pixels),
            "found": [str(finding.fault) for finding in light.findings if finding.found],
        }
    if recorded.presses is not None and found.peaks:
        document["press"] = [
            {"depth_mm": depth, "sigma_mm": plan.press_sigma_mm}
            | _table(one, "read_mm=depth_mm", "x_mm", "y_mm")
            for depth, one in zip(plan.press_depths_mm, found.peaks, strict=True)
        ]
        document["drift_lcd_px"] = found.drift_px
    document["fingerprint"] = recorded.fingerprint
    document["recorded"] = _table(plan, "press_depths_mm", "press_sigma_mm", "edges") | _table(
        recorded, "notes", "values", "seconds"
    )
    document["recorded"]["known"] = list(map(_table_of, plan.known))
    if plan.ball_mm is not None:
        document["recorded"]["ball"] = dict(zip(("radius_mm", "sigma_mm"), plan.ball_mm, strict=True))
    return document


def _edge(search: EdgeSearch) -> dict[str, Any]:
    """What became of the search for an edge, as TOML holds it."""
    table: dict[str, Any] = {"name": search.edge, "words": search.words}
    if isinstance(search.found, MirrorEdge):
        table |= {"pixel": search.found.pixel.tolist(), "sigma_px": search.found.sigma_px}
    return table


def _warp_of(arrays: Mapping[str, Any], name: str) -> Warp:
    q, sigma, flags = (arrays[f"presses/{name}_{part}"] for part in _WARP)
    return Warp(q, sigma, flags, 0)


def _table_of(known: Known) -> dict[str, Any]:
    """What was known in addition, as TOML holds it."""
    if isinstance(known, Direct):
        return {"parameter": known.parameter, "value": known.value, "sigma": known.sigma_value}
    if isinstance(known, Intrinsics):
        numbers = {"values": known.values, "sigma": known.spread, "correlation": known.correlation}
        return {"camera": list(known.names)} | {key: one.tolist() for key, one in numbers.items()}
    return {"edge": known.edge, "pixel": known.pixel.tolist(), "sigma": known.sigma_px}


def _shortfall_of(table: Mapping[str, Any]) -> Shortfall:
    return Shortfall(Part(table["part"]), Lack(table["lack"]), table["why"])


def _values_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """As they were measured; TOML does not say that a measured delay takes the range of one before it out."""
    gone = {"display.latency_range_s": None} if "display.latency_s" in values else {}
    return gone | dict(values)


def _known_of(table: Mapping[str, Any]) -> Known:
    if "edge" in table:
        return MirrorEdge(table["edge"], np.array(table["pixel"], dtype=np.float64), float(table["sigma"]))
    if "camera" in table:
        numbers = (np.array(table[key]) for key in ("values", "sigma", "correlation"))
        return Intrinsics.of(table["camera"], *numbers)
    return Direct(table["parameter"], table["value"], table["sigma"])


def _parameters(fitted: Fit) -> dict[str, Any]:
    sigma, given = fitted.sigma, describe(fitted.priors.rig)
    priors = dict(zip(fitted.priors.names, fitted.priors.sigma, strict=True))
    return {
        name: {"value": value, "sigma": sigma[name], "given": given[name], "given_sigma": priors[name]}
        | _table(PARAMETERS[name], "unit", "words")
        for name, value in fitted.values.items()
    }
