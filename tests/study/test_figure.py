"""Pictures of a table: what is drawn is what the table says."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.figure
import numpy as np
import pytest

from zeromethod.study import parse_study
from zeromethod.view.study_figure import default_figure, draw_study

HEAD = 'schema_version = 1\ntitle = "t"\nrepeats = 3\n[grid]\n"control.gain" = [0.5, 1.0]\n'
VALUES = [(0.5, 1.0), (0.5, 2.0), (0.5, 9.0), (1.0, 4.0), (1.0, 5.0), (1.0, np.nan)]
ROWS = [
    {
        "run": run,
        "repeat": run % 3,
        "seed": run,
        "control.gain": gain,
        "state": "locked",
        "depth_peak_mm": value,
        "failure": None if np.isfinite(value) else "lost",
    }
    for run, (gain, value) in enumerate(VALUES)
]


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[matplotlib.figure.Figure]]:
    """Figures as they are saved."""
    saved: list[matplotlib.figure.Figure] = []
    save = matplotlib.figure.Figure.savefig

    def keep(figure: matplotlib.figure.Figure, *arguments: Any, **named: Any) -> None:
        saved.append(figure)
        save(figure, *arguments, **named)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", keep)
    return saved


def draw(figure: str, path: Path) -> None:
    draw_study(parse_study(HEAD + figure, Path("s.toml")), ROWS, path)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_curves_are_medians_of_what_did_not_fail(drawn: list[Any], tmp_path: Path) -> None:
    draw('[figure]\nkind = "curves"\nx = "control.gain"\nvalue = "depth_peak_mm"\n', tmp_path / "a.png")
    (axis,) = drawn[0].axes
    assert axis.lines[0].get_xydata().tolist() == [[0.5, 2.0], [1.0, 4.5]]
    assert "1 of them failed" in drawn[0]._supxlabel.get_text()


def test_histograms_hold_every_run_once(drawn: list[Any], tmp_path: Path) -> None:
    draw(
        '[figure]\nkind = "histogram"\nvalue = "depth_peak_mm"\nlines = "control.gain"\n', tmp_path / "a.png"
    )
    (axis,) = drawn[0].axes
    assert sum(patch.get_height() for patch in axis.patches) == 5


def test_bars_stand_at_the_medians(drawn: list[Any], tmp_path: Path) -> None:
    draw('[figure]\nkind = "bars"\nx = "control.gain"\nvalue = "depth_peak_mm"\n', tmp_path / "a.png")
    (axis,) = drawn[0].axes
    assert [patch.get_height() for patch in axis.patches] == [2.0, 4.5]


def test_maps_show_every_cell_and_the_border_of_what_is_good(drawn: list[Any], tmp_path: Path) -> None:
    text = (
        '[figure]\nkind = "map"\nx = "control.gain"\ny = "state"\nvalue = "depth_peak_mm"\ngood_below = 3.0\n'
    )
    draw(text.replace("state", "control.gain"), tmp_path / "a.png")
    axis = drawn[0].axes[0]
    cells = axis.images[0].get_array()
    assert np.ma.masked_invalid(cells).compressed().tolist() == [2.0, 4.5]
    assert len(axis.lines) > 0


def test_a_study_without_a_figure_gets_one_that_fits() -> None:
    one = default_figure(parse_study(HEAD, Path("s.toml")), ROWS)
    assert (one.kind, one.x, one.value) == ("curves", "control.gain", "depth_peak_mm")
    without = parse_study('schema_version = 1\ntitle = "t"\n', Path("s.toml"))
    rows = [{key: value for key, value in row.items() if key != "control.gain"} for row in ROWS]
    assert default_figure(without, rows).kind == "histogram"


def test_the_legend_of_curves_covers_none_of_them(drawn: list[Any], tmp_path: Path) -> None:
    draw(
        '[figure]\nkind = "curves"\nx = "run"\nvalue = "depth_peak_mm"\nlines = "control.gain"\n',
        tmp_path / "a.png",
    )
    (axis,) = drawn[0].axes
    (legend,) = drawn[0].legends
    assert [text.get_text() for text in legend.get_texts()] == ["control.gain 0.5", "control.gain 1"]
    assert not legend.get_window_extent().overlaps(axis.get_window_extent())


def test_a_logarithmic_axis_of_less_than_a_decade_has_plain_numbers(drawn: list[Any], tmp_path: Path) -> None:
    text = '[figure]\nkind = "curves"\nx = "run"\nvalue = "depth_peak_mm"\nvalue_scale = "log"\n'
    rows = [row | {"depth_peak_mm": 0.0102 + 0.0003 * row["run"]} for row in ROWS[:3]]
    draw_study(parse_study(HEAD + text, Path("s.toml")), rows, tmp_path / "a.png")
    labels = [label.get_text() for label in drawn[0].axes[0].get_yticklabels()]
    assert len(labels) >= 3
    assert all(0.009 < float(label) < 0.012 for label in labels)
