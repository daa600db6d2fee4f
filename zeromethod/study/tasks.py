"""From a study's settings to its tasks: every value checked before the first run begins."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel

from zeromethod.design.vary import NAMES
from zeromethod.errors import InputError
from zeromethod.rig.load import load_rig, packaged_rigs
from zeromethod.rig.model import Rig
from zeromethod.rig.refusal import shown
from zeromethod.simulation.clone import simulated_clone
from zeromethod.simulation.scenario import load_scenario
from zeromethod.study.axes import DRAW_WORDS, RANGE_WORDS, not_a_word
from zeromethod.study.plan import Point, Study
from zeromethod.study.runs import procedure
from zeromethod.study.settings import press_with, with_settings
from zeromethod.study.task import Procedure, StudyPress, Task

_FILE, _BINNING, _RECORDING = "rig.file", "rig.binning", "recording"
_BENCH, _PRESS = "bench.", "press."
_WORDS = {"grid": RANGE_WORDS, "random": DRAW_WORDS}


def tasks(study: Study) -> list[Task]:
    """Every run of a study, in order.

    Raises InputError, one line "file: key: value: what is allowed", for the first setting that is wrong.
    """
    _loaded.cache_clear()
    _scenario_exists.cache_clear()
    try:
        chosen = procedure(study.table.procedure)
    except InputError as error:
        raise InputError(f"{study.path}: {error}") from None
    _check_keys(study, chosen)
    metrics = _metrics(study, chosen)
    _check_figure(study, metrics)
    if bool(study.table.recordings) != chosen.reads_recordings:
        rule = "needed by" if chosen.reads_recordings else "not allowed with"
        raise InputError(f"{study.path}: recordings: {rule} procedure {study.table.procedure!r}")
    return [_task(study, chosen, metrics, point) for point in study.points()]


def _metrics(study: Study, chosen: Procedure) -> tuple[str, ...]:
    metrics = study.table.metrics if study.table.metrics is not None else tuple(chosen.figures)
    for metric in metrics:
        if metric not in chosen.figures:
            raise InputError(
                f"{study.path}: metrics: {shown(metric)}: of procedure {study.table.procedure!r} one of "
                f"{', '.join(chosen.figures)}"
            )
    if not metrics:
        raise InputError(f"{study.path}: metrics: []: at least one")
    return metrics


def _check_figure(study: Study, metrics: tuple[str, ...]) -> None:
    figure = study.table.figure
    if figure is None:
        return
    known = ["run", *study.varied, *metrics]
    for key, column in (("x", figure.x), ("y", figure.y), *(("hue", hue) for hue in figure.hue)):
        if column not in known:
            raise InputError(f"{study.path}: figure.{key}: {shown(column)}: one of {', '.join(known)}")


def _task(study: Study, chosen: Procedure, metrics: tuple[str, ...], point: Point) -> Task:
    path, table = study.path, study.table
    settings = dict(point.settings)
    name = settings.pop(_FILE, table.rig.file)
    binning = settings.pop(_BINNING, table.rig.binning)
    recording = settings.pop(_RECORDING, None)
    own = {key: settings.pop(key, default) for key, default in chosen.settings.items()}
    press, settings = _split(_PRESS, settings)
    planted, settings = _split(_BENCH, settings)
    rig = bench = None
    try:
        if recording is None:
            start = _load(study, name)
            seed = {"simulation.seed": point.seed} if "simulation.seed" not in settings else {}
            rig = _whole(with_settings(start, settings | seed, binning, path))
            if planted:
                bench = _whole(with_settings(start, settings | seed | planted, binning, path))
        else:
            rig = with_settings(load_rig("simulated"), settings, 1, path)
        pressed = None if table.press is None else press_with(table.press, press, path)
    except InputError as error:
        raise InputError(f"{error} (run {point.run})" if study.count > 1 else str(error)) from None
    return Task(
        run=point.run,
        seed=point.seed,
        procedure=table.procedure,
        rig=rig,
        bench=bench,
        press=pressed,
        frames=table.frames,
        seconds=table.seconds,
        settings=own,
        metrics=metrics,
        recording=recording and str((path.parent / recording).absolute()),
        rig_settings=settings if recording is not None else {},
        limit_s=table.limit_s,
    )


def _split(prefix: str, settings: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Settings below a prefix, which is taken off, and the others."""
    below = {key.removeprefix(prefix): value for key, value in settings.items() if key.startswith(prefix)}
    return below, {key: value for key, value in settings.items() if not key.startswith(prefix)}


def _load(study: Study, name: str) -> Rig:
    if not isinstance(name, str):
        raise InputError(f"{study.path}: rig.file: {shown(name)}: a rig file, or a packaged name")
    try:
        return _loaded(name if name in packaged_rigs() else str(study.path.parent / name))
    except InputError as error:
        raise InputError(f"{study.path}: rig.file: {error}") from None


@lru_cache(maxsize=32)
def _loaded(name: str) -> Rig:
    return simulated_clone(load_rig(name if name in packaged_rigs() else Path(name)))


def _whole(rig: Rig) -> Rig:
    """Rig whose files are named by absolute paths; its press is checked."""
    update: dict[str, Any] = {}
    if rig.scenario.endswith(".toml"):
        update["scenario"] = str(Path(rig.scenario).absolute())
    if rig.prism.rest.file is not None:
        rest = rig.prism.rest.model_copy(update={"file": rig.prism.rest.file.absolute()})
        update["prism"] = rig.prism.model_copy(update={"rest": rest})
    _scenario_exists(update.get("scenario", rig.scenario))
    return rig.model_copy(update=update) if update else rig


@lru_cache(maxsize=256)
def _scenario_exists(name: str) -> None:
    load_scenario(name)


def _check_keys(study: Study, chosen: Procedure) -> None:
    """Raise InputError, one line, for the first key under [set], [grid] or [random] that is unknown."""
    rig = _dotted(Rig)
    press = [_PRESS + name for name in StudyPress.model_fields]
    known = [
        _FILE,
        _BINNING,
        _RECORDING,
        *chosen.settings,
        *NAMES,
        *press,
        *rig,
        *(_BENCH + key for key in rig),
    ]
    tables = {"set": study.table.settings, "grid": study.axes, "random": study.table.random}
    for table, keys in tables.items():
        for key in keys:
            _check_word(study, table, key, known)
            if key in known or _may_be(key):
                continue
            nearest = difflib.get_close_matches(key, known, n=1)
            hint = (
                f"did you mean {nearest[0]}?"
                if nearest
                else "a dotted key of a rig file, or of docs/study.md"
            )
            raise InputError(f'{study.path}: {table}: "{key}": unknown key: {hint}')


def _check_word(study: Study, table: str, key: str, known: list[str]) -> None:
    """Refuse { unifrm = [low, high] }, which reads as a further step of the key that it is given to."""
    before, _, word = key.rpartition(".")
    words = _WORDS.get(table, ())
    value = before in known and not any(other.startswith(f"{before}.") for other in known)
    # keys inside a list are checked by the rig itself, and "press" is a key of its own and a table as well
    likely = (before in known or "[" in before) and difflib.get_close_matches(word, words, n=1)
    if words and (value or likely):
        raise not_a_word(f"{study.path}: {table}.{before}", word, words)


def _may_be(key: str) -> bool:
    """Whether only the rig itself can check a key: one inside a list, or in a table that takes any key."""
    model: Any = Rig
    for step in key.removeprefix(_BENCH).split("."):
        if "[" in step:
            return True
        if not (isinstance(model, type) and issubclass(model, BaseModel)) or step not in model.model_fields:
            return False
        model = _model(model.model_fields[step].annotation)
    return True


def _dotted(model: type[BaseModel], before: str = "") -> list[str]:
    """Dotted keys of all values of a model."""
    keys = []
    for name, field in model.model_fields.items():
        inner = _model(field.annotation)
        keys += _dotted(inner, f"{before}{name}.") if inner is not None else [f"{before}{name}"]
    return keys


def _model(annotation: Any) -> type[BaseModel] | None:
    """The table that an annotation is, or may be; None for anything else, a list of tables included."""
    if get_origin(annotation) in (tuple, list):
        return None
    if isinstance(annotation, type):
        return annotation if issubclass(annotation, BaseModel) else None
    found = (part for part in get_args(annotation) if isinstance(part, type))
    return next((part for part in found if issubclass(part, BaseModel)), None)
