"""One recording as one HTML file: figures, pictures, settings, how to reproduce it."""

from __future__ import annotations

import warnings as raised
from collections.abc import Callable, Iterator
from pathlib import Path

import jinja2
import numpy as np

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.loop.state import State
from zeromethod.recording.damage import KINDS
from zeromethod.recording.recording import Recording
from zeromethod.recording.source import DamagedWarning
from zeromethod.surface import Peak
from zeromethod.view.report_figures import LEAST_RATED, depth_map, timeline
from zeromethod.view.report_history import at_turns, happenings, states
from zeromethod.view.report_summary import Figures, largest_peak, peak_figures, summarise_recording
from zeromethod.view.report_words import (
    calibration_parts,
    commands,
    damage_rows,
    happening_row,
    note_rows,
    peak_words,
    rig_rows,
    settings_rows,
    state_shares,
    subtitle,
    summary_rows,
    version_rows,
    warnings,
)

MOST_HAPPENINGS = 300
"""Drops and faults that are listed; of more, the page gives the number."""

STEPS = ("figures", *(f"checking {several}" for _, several in KINDS.values()), "curves", "depth maps", "page")

_TEMPLATE = Path(__file__).with_name("report.html")


def write_report(
    recording: Recording, path: Path, output: Path, advance: Callable[[str], None] = lambda _: None
) -> Figures:
    """Write the page of the recording at `path`, in one move; returns the figures of its summary.

    All arrays are read once, to count the damaged ones; of a recording that is still being
    written, those that are complete.
    advance: called after each of the `STEPS` with the name of the next one.
    """
    following = iter(STEPS[1:])
    figures = summarise_recording(recording)
    advance(next(following))
    figures["damaged"] = recording.damaged(lambda: advance(next(following)))
    curves = timeline(recording) if figures["turns"] else ""
    advance("depth maps")
    maps, damaged = _maps(recording)
    advance("page")
    with atomic_write(output) as part:
        part.write_text(_render(recording, path, figures, curves, maps, damaged), encoding="utf-8")
    advance("")
    return figures


def report(recording: Recording | str | Path, path: str | Path | None = None) -> Figures:
    """Write a recording as one HTML page that needs nothing else.

    Parameters
    ----------
    recording : Recording, str or Path
        What to report; it may still be written.
    path : str or Path, optional
        The page (.html); by default next to the recording, under its name.

    Returns
    -------
    dict
        Figures of the page's summary.

    Raises
    ------
    InputError
        For a recording that cannot be read.
    """
    if not isinstance(recording, Recording):
        with Recording(recording) as opened:
            return report(opened, path)
    output = recording.path.with_suffix(".html") if path is None else Path(path)
    return write_report(recording, recording.path, output)


def _render(
    recording: Recording,
    path: Path,
    figures: Figures,
    curves: str,
    maps: list[dict[str, str]],
    damaged: list[str],
) -> str:
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    happened = happenings(recording)
    return environment.from_string(_TEMPLATE.read_text(encoding="utf-8")).render(
        title=f"{recording.rig.name}: {path.name}",
        subtitle=subtitle(recording, figures),
        warnings=list(warnings(path, figures)),
        shares=state_shares(figures),
        summary=list(summary_rows(figures, recording.rig)),
        timeline=curves,
        too_few=figures["frames"] if curves and figures["frames"] < LEAST_RATED else 0,
        least_rated=LEAST_RATED,
        maps=maps,
        without_maps=damaged or list(_without_maps(recording, maps)),
        happenings=[*damage_rows(figures), *(happening_row(one) for one in happened[:MOST_HAPPENINGS])],
        more_happenings=max(len(happened) - MOST_HAPPENINGS, 0),
        notes=note_rows(recording),
        rig=list(rig_rows(recording.rig)),
        **calibration_parts(recording),
        reproduce=list(commands(recording, path)),
        settings=list(settings_rows(recording)),
        rig_text=recording.rig_text,
        versions=list(version_rows(recording)),
    )


def _maps(recording: Recording) -> tuple[list[dict[str, str]], list[str]]:
    """Depth when first locked, at its largest and at the end, where surfaces were kept; what is damaged."""
    maps, damaged = [], []
    for turn, names in key_turns(recording).items():
        try:
            with raised.catch_warnings():
                raised.simplefilter("error", DamagedWarning)
                surface = recording.surface(turn)
        except (InputError, DamagedWarning) as error:
            damaged.append(f"{', '.join(names)}: no depth map: {error}")
            continue
        assert surface is not None
        rows = np.flatnonzero((recording.peaks["step"] == turn) & np.isfinite(recording.peaks["depth_mm"]))
        figures = peak_figures(recording, int(rows[0]) if len(rows) else None)
        point = [figures[name] if figures else np.nan for name in ("depth_mm", "x_mm", "y_mm", "sigma_mm")]
        words = f"turn {turn}" if figures is None else f"turn {turn}: {peak_words(figures)}"
        maps.append({"name": ", ".join(names), "svg": depth_map(surface, Peak(*point)), "words": words})
    return maps, damaged


def key_turns(recording: Recording) -> dict[int, list[str]]:
    """Turns whose depth is shown, and what each is: only those whose surface was kept."""
    kept = recording.steps_with("surface")
    index, there = at_turns(recording, kept)
    kept, names = kept[there], states(recording)[index[there]]
    if not len(kept):
        return {}
    found: dict[int, list[str]] = {}
    for state in (State.LOCKED, State.RESTING):
        if (names == state).any():
            found.setdefault(int(kept[np.argmax(names == state)]), []).append(f"first {state}")
            break
    row = largest_peak(recording, np.isin(recording.peaks["step"], kept))
    if row is not None:
        found.setdefault(int(recording.peaks["step"][row]), []).append("largest |depth|")
    found.setdefault(int(kept[-1]), []).append("last")
    return found


def _without_maps(recording: Recording, maps: list[dict[str, str]]) -> Iterator[str]:
    """Why depth maps are missing."""
    if "surface" not in recording.kept:
        yield "No depth maps: the surface was not kept (--keep without surface)."
    elif not maps:
        yield "No depth maps: no surface was read."
    elif not any(one["name"].startswith("first") for one in maps):
        yield "No surface was kept while the loop was locked."
