"""Pictures of a table: what is drawn is what the table says."""

from collections.abc import Callable
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
        "state": "locked" if gain < 1.0 else "lost",
        "depth_peak_mm": value,
        "failure": None if np.isfinite(value) else "lost",
    }
    for run, (gain, value) in enumerate(VALUES)
]


@pytest.fixture
def draw(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[..., Any]:
    """Draw rows as a table [figure] asks for; the figure as it was saved."""
    saved: list[matplotlib.figure.Figure] = []
    save = matplotlib.figure.Figure.savefig

    def keep(figure: matplotlib.figure.Figure, *arguments: Any, **named: Any) -> None:
        saved.append(figure)
        save(figure, *arguments, **named)

    monkeypatch.setattr(matplotlib.figure.Figure, "savefig", keep)

    def drawn(figure: str, rows: list[dict[str, Any]] = ROWS) -> Any:
        text = f'{HEAD}[figure]\ny = "depth_peak_mm"\n{figure}'
        draw_study(parse_study(text, Path("s.toml")), rows, tmp_path / "a.png")
        assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
        return saved[-1]

    return drawn


def test_lines_are_medians_of_what_did_not_fail(draw):
    figure = draw('x = "control.gain"')
    (axis,) = figure.axes
    assert axis.lines[0].get_xydata().tolist() == [[0.5, 2.0], [1.0, 4.5]]
    assert (axis.get_xlabel(), axis.get_ylabel()) == ("control.gain", "depth_peak_mm")
    assert "1 of them failed" in figure._supxlabel.get_text()


def test_words_stand_in_their_order(draw):
    (axis,) = draw('x = "state"').axes
    assert axis.lines[0].get_xydata().tolist() == [[0.0, 2.0], [1.0, 4.5]]
    assert [label.get_text() for label in axis.get_xticklabels()] == ["locked", "lost"]


def test_two_hues_differ_by_style_and_colour(draw):
    (axis,) = draw('x = "run"\nhue = ["state", "repeat"]\n').axes
    # the failed run has nothing to show
    looks = [(line.get_label(), line.get_linestyle(), line.get_color()) for line in axis.lines]
    assert looks == [
        ("locked, repeat 0", "-", "C0"),
        ("locked, repeat 1", "-", "C1"),
        ("locked, repeat 2", "-", "C2"),
        ("lost, repeat 0", "--", "C0"),
        ("lost, repeat 1", "--", "C1"),
    ]


def test_a_study_without_a_figure_gets_one_that_fits():
    one = default_figure(parse_study(HEAD, Path("s.toml")), ROWS)
    assert (one.x, one.y, one.hue) == ("control.gain", "depth_peak_mm", ())
    without = parse_study('schema_version = 1\ntitle = "t"\n', Path("s.toml"))
    rows = [{key: value for key, value in row.items() if key != "control.gain"} for row in ROWS]
    assert default_figure(without, rows).x == "run"


def test_the_legend_covers_no_line(draw):
    figure = draw('x = "run"\nhue = ["control.gain"]\n')
    (axis,), (legend,) = figure.axes, figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ["control.gain 0.5", "control.gain 1"]
    assert not legend.get_window_extent().overlaps(axis.get_window_extent())


@pytest.mark.parametrize("scale", ["log", "loglog"])
def test_a_logarithmic_axis_of_less_than_a_decade_has_plain_numbers(draw, scale):
    rows = [row | {"depth_peak_mm": 0.0102 + 0.0003 * row["run"], "run": row["run"] + 1} for row in ROWS[:3]]
    (axis,) = draw(f'x = "run"\nscale = "{scale}"\n', rows).axes
    labels = [label.get_text() for label in axis.get_yticklabels()]
    assert len(labels) >= 3
    assert all(0.009 < float(label) < 0.012 for label in labels)
    assert (axis.get_xscale(), axis.get_yscale()) == ("log" if scale == "loglog" else "linear", "log")
