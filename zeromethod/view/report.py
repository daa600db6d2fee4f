"""One recording as one HTML file: figures, pictures, settings, how to reproduce it."""

from __future__ import annotations

import time
import warnings as raised
from collections.abc import Callable, Iterator
from pathlib import Path

import jinja2
import numpy as np

from zeromethod.atomic_write import atomic_write
from zeromethod.errors import InputError
from zeromethod.export.source import MapSource
from zeromethod.loop.state import State
from zeromethod.recording.damage import KINDS
from zeromethod.recording.recording import Recording
from zeromethod.recording.source import DamagedWarning
from zeromethod.view import report_words as words
from zeromethod.view.live import STATE_COLOURS
from zeromethod.view.report_figures import LEAST_RATED, contact_image, depth_map, events, pixel_map, timeline
from zeromethod.view.report_history import happenings
from zeromethod.view.report_summary import (
    Figures,
    largest_peak,
    peak_figures,
    read_peaks,
    summarise_recording,
)

MOST_HAPPENINGS = 300
"""Drops and faults that are listed; of more, the page gives the number."""

STEPS = (*(f"checking {several}" for _, several in KINDS.values()), "figures", "curves", "depth maps", "page")

_TEMPLATE = Path(__file__).with_name("report.html")


def write_report(
    recording: Recording, path: Path, output: Path, advance: Callable[[str], None] = lambda _: None
) -> Figures:
    """Write the page of the recording at `path`, in one move; returns the figures of its summary.

    All arrays and rows are read once, to count the damaged ones; of a recording that is still being
    written, those that are complete.
    advance: called after each of the `STEPS` with the name of the next one.
    """
    following, silent_s = iter(STEPS[1:]), time.time() - path.stat().st_mtime
    # first: what is damaged is then in no figure
    damaged = recording.damaged(lambda: advance(next(following)))
    figures = summarise_recording(recording) | {"damaged": damaged}
    advance(next(following))
    curves = timeline(recording) if figures["steps"] else ""
    advance("depth maps")
    maps, unmapped = _maps(recording)
    advance("page")
    happened = happenings(recording)
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    page = environment.from_string(_TEMPLATE.read_text(encoding="utf-8")).render(
        title=f"{recording.rig.name}: {path.name}",
        subtitle=words.subtitle(recording, figures),
        warnings=words.warnings(silent_s, figures),
        shares=figures["shares"],
        colours=STATE_COLOURS,
        summary=words.summary_rows(figures, recording.rig),
        timeline=curves,
        events=list(events(recording)),
        too_few=figures["frames"] if curves and figures["frames"] < LEAST_RATED else 0,
        least_rated=LEAST_RATED,
        maps=maps,
        without_maps=unmapped or _without_maps(recording, maps),
        happenings=list(words.happening_rows(figures, happened[:MOST_HAPPENINGS])),
        more_happenings=max(len(happened) - MOST_HAPPENINGS, 0),
        notes=words.note_rows(recording),
        rig=words.rig_rows(recording.rig),
        **words.calibration_parts(recording),
        reproduce=words.commands(recording, path),
        settings=words.settings_rows(recording),
        rig_text=recording.rig_text,
        versions=words.version_rows(recording),
    )
    with atomic_write(output) as part:
        part.write_text(page, encoding="utf-8")
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


def _maps(recording: Recording) -> tuple[list[dict[str, str]], list[str]]:
    """Depth when first locked, at its largest and at the end, where surfaces were kept; what is damaged."""
    maps, damaged, peaks, contacts = [], [], read_peaks(recording), recording.contacts
    for step, names in key_steps(recording).items():
        try:
            with raised.catch_warnings():
                raised.simplefilter("error", DamagedWarning)
                surface = recording.surface(step)
        except (InputError, DamagedWarning) as error:
            damaged.append(f"{', '.join(names)}: no depth map: {error}")
            continue
        assert surface is not None
        peak = peak_figures(peaks[peaks["step"] == step])
        said = f"step {step}" if peak is None else f"step {step}: {words.peak_words(peak)}"
        point = (np.nan, np.nan) if peak is None else (peak["x_mm"], peak["y_mm"])
        touching = contacts[contacts["step"] == step]
        borders = touching["outline_mm"].astype(np.float64)
        maps.append({"name": ", ".join(names), "svg": depth_map(surface, point, borders), "words": said})
        for number, image in recording.contact_images(step).items():
            border = next((b for b, one in zip(borders, touching["id"], strict=True) if one == number), None)
            about = f"step {step}: {1e3 * image.mm_per_px:.0f} µm per pixel"
            maps.append({"name": f"contact {number}", "svg": contact_image(image, border), "words": about})
    return maps + _pixel_maps(recording), damaged


def _pixel_maps(recording: Recording) -> list[dict[str, str]]:
    """Depth on every pixel at the largest peak of the locked mirror, where fine surfaces were kept."""
    source = MapSource(recording, fine=True)
    kept = recording.turns[np.isin(recording.turns["number"], list(source.numbers))]
    step = source.deepest(kept)
    surface = None if step is None else recording.fine(step)
    if surface is None:
        return []
    depth_mm, x_mm, y_mm = surface.peak
    sigma_um = 1e3 * surface.sigma_near(x_mm, y_mm)
    said = f"step {step}: {1e3 * depth_mm:.4f} ± {sigma_um:.4f} µm at {x_mm:.2f}, {y_mm:.2f} mm"
    return [{"name": "every pixel", "svg": pixel_map(surface), "words": f"{said}; {surface.frames} frames"}]


def key_steps(recording: Recording) -> dict[int, list[str]]:
    """Steps whose depth is shown, and what each is: only those whose surface was kept."""
    steps, peaks = recording.turns, read_peaks(recording)
    kept = steps[np.isin(steps["number"], recording.steps_with("surface"))]
    states = [recording.state_of(step) for step in kept]
    shown = [
        (f"first {state}", kept["number"][states.index(state)])
        for state in (State.LOCKED, State.RESTING)
        if state in states
    ][:1]
    largest = largest_peak(peaks[np.isin(peaks["step"], kept["number"])])
    shown += [("largest |depth|", number) for number in largest["step"]]
    shown += [("last", number) for number in kept["number"][-1:]]
    return {int(one): [name for name, number in shown if number == one] for _, one in shown}


def _without_maps(recording: Recording, maps: list[dict[str, str]]) -> Iterator[str]:
    """Why depth maps are missing."""
    if "surface" not in recording.kept:
        yield "No depth maps: the surface was not kept (--keep without surface)."
    elif not maps:
        lost = recording.tables.left_out().get("peaks") and "the rows of its steps and peaks are damaged"
        yield f"No depth maps: {lost or 'no surface was read'}."
    elif not any(one["name"].startswith("first") for one in maps):
        yield "No surface was kept while the loop was locked."
