"""A calibration as a folder on disk, and what was recorded back from one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from zeromethod.calibration.edges import EdgeSearch
from zeromethod.calibration.fit import Fit
from zeromethod.calibration.folder import ARRAYS, GIVEN, Stored, load, load_arrays, store
from zeromethod.calibration.measurements import Direct, Intrinsics, MirrorEdge
from zeromethod.calibration.parameters import PARAMETERS, describe
from zeromethod.commissioning.calibration.evaluation import Calibration
from zeromethod.commissioning.calibration.plan import Known, Plan, Recorded
from zeromethod.commissioning.calibration.presses import PressWarps
from zeromethod.commissioning.calibration.rest import RestFrames
from zeromethod.commissioning.calibration.settling import Settling
from zeromethod.commissioning.decode import figures
from zeromethod.decoding.fringes import Axis, FringeSequence
from zeromethod.errors import InputError
from zeromethod.rig.load import load_rig
from zeromethod.warp.warp import Warp

_OFFERS = 6
_DELAY = ("latency_s", "sigma_s", "jitter_s", "refresh_hz", "camera_rate_hz", "horizon_s", "frames", "used")
_WARP = ("q", "sigma", "flags")
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
    document = document_of(found)
    if again is not None:
        kept = {key: again.document[key] for key in _KEPT if key in again.document}
        document |= {**kept, "redone_from": again.folder.name}
    return store(
        name, document, found.values, arrays_of(found), settings=settings, pictures=pictures, home=home
    )


def recall(folder: Path) -> tuple[Recorded, Stored]:
    """What was recorded for a calibration, to evaluate it again. Raises InputError."""
    stored = load(folder)
    raw = stored.document["recorded"]
    names = ("periods_px", "shifts_rad", "axes", "repeats", "frames", "sums")
    arrays = load_arrays(folder)
    if missing := [f"raw/{name}" for name in names if f"raw/{name}" not in arrays]:
        raise InputError(f"{folder / ARRAYS}: {missing[0]}: missing: arrays of a calibration")
    periods, shifts, axes, repeats, frames, sums = (arrays[f"raw/{name}"] for name in names)
    axes_given: tuple[Axis, Axis] = ("columns", "rows") if str(axes[0]) == "columns" else ("rows", "columns")
    sequence = FringeSequence(tuple(map(float, periods)), tuple(map(float, shifts)), axes_given, int(repeats))
    presses = None
    if "presses/rest_q" in arrays:
        pressed: tuple[Warp, ...] = ()
        if "presses/pressed_q" in arrays:
            q, sigma, flags = (arrays[f"presses/pressed_{part}"] for part in _WARP)
            pressed = tuple(Warp(q[i], sigma[i], flags[i], 0) for i in range(len(q)))
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
        values=raw.get("values", {}),
        notes=tuple(raw.get("notes", ())),
    )
    return recorded, stored


def arrays_of(found: Calibration) -> dict[str, Any]:
    """Arrays of a calibration by name."""
    recorded, rest = found.recorded, found.rest.rest_map
    raw, sequence = recorded.rest, recorded.rest.sequence
    arrays: dict[str, Any] = {
        "rest_map/lcd_px": rest.lcd_px,
        "rest_map/sigma_px": rest.sigma_px.astype(np.float32),
        "rest_map/valid": rest.valid,
        "rest_map/reason": rest.reason,
        "fit/names": list(found.fitted.priors.names),
        "fit/prior_mean": found.fitted.priors.mean,
        "fit/prior_sigma": found.fitted.priors.sigma,
        "fit/z": found.fitted.z,
        "fit/covariance": found.fitted.covariance,
        "depth_error/sensitivity": found.error.sensitivity,
        "raw/sums": raw.sums,
        "raw/frames": raw.frames,
        "raw/periods_px": np.array(sequence.periods_px),
        "raw/shifts_rad": np.array(sequence.shifts_rad),
        "raw/axes": list(sequence.axes),
        "raw/repeats": sequence.repeats,
    }
    if recorded.presses is not None:
        warps, rest_warp = recorded.presses.pressed, recorded.presses.rest
        for part in _WARP:
            arrays[f"presses/rest_{part}"] = getattr(rest_warp, part)
            if warps:
                arrays[f"presses/pressed_{part}"] = np.stack([getattr(warp, part) for warp in warps])
            if recorded.presses.ball is not None:
                arrays[f"presses/ball_{part}"] = getattr(recorded.presses.ball, part)
    if recorded.light is not None:
        light = recorded.light
        arrays |= {
            "light/codes": light.response.codes,
            "light/light": light.response.whole.light,
            "light/sigma": light.response.whole.sigma,
            "light/lit": light.lit,
            "light/falloff": light.falloff.smooth.astype(np.float32),
            "light/bad_pixels": light.bad_pixels.reason,
        }
    return arrays


def document_of(found: Calibration) -> dict[str, Any]:
    """calibration.toml of a calibration, as plain values."""
    recorded, fitted, error = found.recorded, found.fitted, found.error
    percent = error.percent
    document: dict[str, Any] = {
        "time": datetime.now(UTC).replace(microsecond=0),
        "rig": recorded.rig.name,
        "made_by": f"zeromethod {version('zeromethod')}",
        "verdict": {
            "level": found.verdict.level.value,
            "reason": found.verdict.reason,
            "findings": list(found.verdict.findings),
        },
        "depth_error": {
            "percent": found.depth_percent,
            "worst_percent": float(percent.max()),
            "region": [
                {"name": name, "x_mm": x, "y_mm": y, "percent": one}
                for name, x, y, one in zip(error.names, error.x_mm, error.y_mm, percent, strict=True)
            ],
        },
        "parameters": _parameters(fitted),
        "fit": {
            "chi2_per_freedom": fitted.chi2_per_freedom,
            "rest_map_sigma_factor": fitted.inflation,
            "settled": fitted.settled,
            "data": [
                {"name": term.measurement.name, "numbers": term.count, "outliers": term.outliers}
                for term in fitted.terms
            ],
        },
        "not_told_apart": [
            {"words": one.words, "kept": one.kept, "depth_percent": one.depth_percent}
            for one in found.open_blends
        ],
        "measure_next": [{"what": one.what, "depth_percent": one.percent} for one in found.gains[:_OFFERS]],
        "edge": [_edge(one) for one in found.edges],
        "rest_map": figures(found.rest),
        "settling": asdict(recorded.settling),
    }
    if recorded.delay is not None:
        document["delay"] = {key: getattr(recorded.delay, key) for key in _DELAY}
    if recorded.panel is not None:
        document["panel"] = asdict(recorded.panel)
    if recorded.light is not None:
        document["light"] = _light(recorded)
    if recorded.presses is not None and found.peaks:
        document["press"] = [
            {"depth_mm": depth, "sigma_mm": recorded.plan.press_sigma_mm, "read_mm": one.depth_mm}
            | {"x_mm": one.x_mm, "y_mm": one.y_mm}
            for depth, one in zip(recorded.plan.press_depths_mm, found.peaks, strict=True)
        ]
        document["drift_lcd_px"] = found.drift_px
    document["fingerprint"] = recorded.fingerprint
    document["recorded"] = {
        "press_depths_mm": list(recorded.plan.press_depths_mm),
        "press_sigma_mm": recorded.plan.press_sigma_mm,
        "edges": recorded.plan.edges,
        "known": list(map(_table_of, recorded.plan.known)),
        "notes": list(recorded.notes),
        "values": recorded.values,
        "seconds": recorded.seconds,
    }
    if recorded.plan.ball_mm is not None:
        radius, sigma = recorded.plan.ball_mm
        document["recorded"]["ball"] = {"radius_mm": radius, "sigma_mm": sigma}
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
        name: {
            "value": value,
            "sigma": sigma[name],
            "given": given[name],
            "given_sigma": float(priors[name]),
            "unit": PARAMETERS[name].unit,
            "words": PARAMETERS[name].words,
        }
        for name, value in fitted.values.items()
    }


def _light(recorded: Recorded) -> dict[str, Any]:
    light = recorded.light
    assert light is not None
    curve = light.response.whole
    return {
        "gamma": curve.gamma,
        "gamma_sigma": curve.gamma_sigma,
        "power_law_misfit": curve.misfit,
        "read_grey": light.noise.read_grey,
        "electrons_per_grey": light.noise.electrons_per_grey,
        "black_grey": light.noise.black.grey,
        "black_sigma_grey": light.noise.black.sigma,
        "darkest_share": light.falloff.darkest,
        "bad_pixels": int(np.count_nonzero(light.bad_pixels.mask)),
        "found": [str(finding.fault) for finding in light.findings if finding.found],
        "advice": list(light.advice),
    }
