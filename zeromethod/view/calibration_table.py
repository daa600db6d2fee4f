"""A stored calibration as tables of plain words, alone or next to another one."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any

from rich.table import Table
from rich.text import Text

from zeromethod.calibration.fingerprint import OF_DEVICES, WORDS
from zeromethod.calibration.folder import Stored
from zeromethod.calibration.level import Level
from zeromethod.view.table import pair_table, text_table

_COLOURS = {Level.GOOD: "green", Level.UNCERTAIN: "yellow", Level.BAD: "red"}
_OFFERS, _OPEN = 4, 4
NOTABLE = 3.0
"""Change of a parameter, in its sigma, that is marked."""


def verdict_line(stored: Stored) -> Text:
    """The verdict with its most important reason, on one line."""
    verdict = stored.document["verdict"]
    text = Text(f"{stored.level}: ", style=_COLOURS[stored.level])
    return text.append(verdict["reason"], style="default")


def depth_line(stored: Stored) -> str:
    """What the geometry leaves open of depth, in words."""
    error = stored.document["depth_error"]
    worst = max(error["region"], key=lambda one: one["percent"])
    return (
        f"depth in millimetres: {error['percent']:.2f} % (1 sigma, by geometry), "
        f"{worst['percent']:.2f} % at worst ({worst['name']})"
    )


def carrier_line(stored: Stored) -> str:
    """What another period of the carrier would bring, in words; empty where the present one is as good."""
    return str(stored.document.get("carrier", {}).get("words", ""))


def parameter_table(stored: Stored) -> Table:
    """Every parameter: as the rig file had it, as found, and how well it is known."""
    entries = stored.document["parameters"].values()
    rows = []
    for one in entries:
        numbers = [f"{one[key]:z.{_digits(one['sigma'])}f}" for key in ("given", "value", "sigma")]
        rows.append((one["words"], *numbers, one["unit"]))
    return text_table(("parameter", "given", "found", "sigma", "unit"), rows, left=(0, 4))


def figure_table(stored: Stored) -> Table:
    """Everything else that was measured."""
    return pair_table(_figures(stored.document))


_PANEL = (("scanout", "scan-out"), ("rise", "rise, 10 to 90 %"), ("fall", "fall, 90 to 10 %"))


def _figures(document: dict[str, Any]) -> Iterator[tuple[str, str]]:
    yield "made", f"{document['time']:%Y-%m-%d %H:%M} UTC, {document.get('made_by', '')}"
    for key, words in WORDS.items():
        if key in OF_DEVICES:
            table, name = key.split(".")
            if name in document["fingerprint"].get(table, {}):
                yield words, str(document["fingerprint"][table][name])
    rest = document["rest_map"]
    yield "camera pixels with a place on the LCD", f"{rest['valid_share']:.1%}"
    yield (
        "camera pixels left out",
        ", ".join(f"{name} {count}" for name, count in rest["reasons_px"].items() if count) or "none",
    )
    yield (
        "sigma of the rest map, LCD px",
        f"{rest['sigma_column_median_px']:.4f}, {rest['sigma_row_median_px']:.4f}",
    )
    fit = document["fit"]
    yield "misfit (chi-squared per number)", f"{fit['chi2_per_freedom']:.2f}"
    yield from _light(document)
    if "projector" in document:
        yield "sigma of the projector's picture on the mirror, mm", f"{document['projector']['sigma_mm']:.3f}"
    for edge in document.get("edge", ()):
        yield f"edge {edge['name']}", edge["words"]
    for number, press in enumerate(document.get("press", ()), start=1):
        yield (
            f"press {number}",
            f"{press['depth_mm']:g} mm at x = {press['x_mm']:z.1f}, y = {press['y_mm']:z.1f} mm, "
            f"read {press['read_mm']:.4f} mm",
        )
    for one in document.get("not_told_apart", ())[:_OPEN]:
        yield "not separated", f"{one['words']} ({one['depth_percent']:.2f} % of depth)"
    for one in document.get("measure_next", ())[:_OFFERS]:
        yield "would bring depth to", f"{one['depth_percent']:.2f} %: {one['what']}"
    for finding in document["verdict"]["findings"][1:]:
        yield "also", finding


def _light(document: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """The LCD's light and its times."""
    if (light := document.get("light")) is not None:
        yield "gamma of the LCD", f"{light['gamma']:.3f} ({light['gamma_sigma']:.3f})"
        yield "camera noise in the dark", f"{light['read_grey']:.2f} grey levels"
        if light["found"]:
            yield "to switch off", ", ".join(light["found"])
    if (delay := document.get("delay")) is not None:
        yield "delay", f"{1e3 * delay['latency_s']:.2f} ms ({1e3 * delay['sigma_s']:.2f})"
        yield "LCD, camera", f"{delay['refresh_hz']:.3f} Hz, {delay['camera_rate_hz']:.3f} frames per second"
    if (panel := document.get("panel")) is not None:
        for key, words in _PANEL:
            if (sigma_s := panel.get(f"{key}_sigma_s")) is not None:
                yield words, f"{1e3 * panel[f'{key}_s']:.2f} ms ({1e3 * sigma_s:.2f})"


def difference_table(before: Stored, after: Stored) -> Table:
    """What differs between two calibrations: parameters by size of the change, then the rest."""
    rows = [row for _, row in sorted(_changes(before, after), reverse=True)]
    rows += [(*row, "", "") for row in _others(before, after)]
    return text_table(("", before.folder.name, after.folder.name, "change", "in sigma"), rows)


def _changes(before: Stored, after: Stored) -> Iterator[tuple[float, tuple[str, ...]]]:
    old, new = before.parameters, after.parameters
    for name, (value, sigma) in new.items():
        if name not in old:
            continue
        change = value - old[name][0]
        size = abs(change) / max(math.hypot(sigma, old[name][1]), 1e-300)
        digits = _digits(sigma)
        mark = " !" if size > NOTABLE else ""
        entry = after.document["parameters"][name]
        numbers = (f"{old[name][0]:z.{digits}f}", f"{value:z.{digits}f}", f"{change:+z.{digits}f}")
        yield size, (f"{entry['words']}, {entry['unit']}".rstrip(", "), *numbers, f"{size:.1f}{mark}")


def _others(before: Stored, after: Stored) -> Iterator[tuple[str, str, str]]:
    both = before.document, after.document

    def pair(words: str, value: Callable[[dict[str, Any]], str]) -> tuple[str, str, str]:
        return words, value(both[0]), value(both[1])

    yield pair("depth's sigma, percent", lambda one: f"{one['depth_error']['percent']:.2f}")
    yield pair("verdict", lambda one: str(one["verdict"]["level"]))
    if all("delay" in one for one in both):
        yield pair("delay, ms", lambda one: f"{1e3 * one['delay']['latency_s']:.2f}")
    if all("light" in one for one in both):
        yield pair("gamma of the LCD", lambda one: f"{one['light']['gamma']:.3f}")
    for key, words in WORDS.items():
        table, name = key.split(".")
        values = [str(one["fingerprint"].get(table, {}).get(name, "unknown")) for one in both]
        if values[0] != values[1]:
            yield words, values[0], values[1]


def _digits(sigma: float) -> int:
    """Decimals that show two digits of sigma."""
    return min(max(1 - math.floor(math.log10(sigma)), 0), 7) if sigma > 0 else 4
