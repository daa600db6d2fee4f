"""The picture of a run: whatever there is of it is drawn, and its title hides no error."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from planted_dents import ball, outwards, rig, round_contact, surface
from small_rigs import paper

import zeromethod as zm
from benchmarks.rigs import coarser
from zeromethod import load_rig, summarise
from zeromethod.approach import Approach, Watching
from zeromethod.interactive.pointers import Pointers
from zeromethod.page.run_content import residual_maps
from zeromethod.view.axes import colour_bar
from zeromethod.view.events_figure import draw_approaches, draw_pointers
from zeromethod.view.figure import _draw_pressure, _section, _title, plot_run
from zeromethod.warp.grid import PADDING
from zeromethod.warp.validity import Flag


@pytest.mark.parametrize("frames", [1, 8])
def test_a_run_on_the_papers_bench_that_ended_early_is_drawn(frames: int, tmp_path: Path) -> None:
    """Whole columns of its nodes never have a reading."""
    with zm.Session(paper("step")) as session:
        for step in session.run(frames=100):
            if step.number == frames:
                session.interrupt()
        plot_run(session, tmp_path / "p.png")
    assert session.result.interrupted
    assert (tmp_path / "p.png").stat().st_size > 10_000
    assert [path.name for path in tmp_path.iterdir()] == ["p.png"]


def _titles(session: zm.Session) -> list[str]:
    return [axis.get_title() for axis in plot_run(session).axes]


def test_a_run_that_never_presses_shows_what_it_read_and_calls_nothing_pressed() -> None:
    with zm.Session(coarser(load_rig("simulated"), 8)) as session:
        *_, last = session.run(frames=5)
        titles = _titles(session)
    assert f"read: untouched, {last.state} ({last.time_s:.2f} s)" in titles
    assert f"residual: untouched, {last.state}" in titles
    assert not re.search("pressed|before|nulled", " ".join(titles))


def test_maps_of_a_saw_leave_its_seams_out_and_say_why() -> None:
    """What windows at a seam see is of two teeth: no residual, neither in the picture nor on the page."""
    with zm.Session(coarser(load_rig("thin"), 2)) as session:
        *_, last = session.run(frames=3)
        axes = {axis.get_title(): axis for axis in plot_run(session).axes}
    assert last.residual is not None
    assert last.measured is not None
    seam = last.measured.flags & Flag.SEAM != 0
    on_page, said = residual_maps(last.residual, last.measured, last.number)
    assert (seam & last.residual.valid).any()
    assert np.isnan(on_page["length"][seam]).all()
    assert said["seams"]
    for name in (f"residual: untouched, {last.state}", "measured warp, along LCD columns"):
        drawn = axes[f"{name}\nseams between teeth: masked"].collections[0].get_array()
        assert drawn is not None
        assert np.ma.getmaskarray(np.ma.masked_invalid(drawn))[seam[PADDING:-PADDING, PADDING:-PADDING]].all()


def test_a_run_that_ends_under_a_press_shows_that_press() -> None:
    # comes down between two frames at 0.2 s
    with zm.Session(coarser(load_rig("simulated"), 8).replace(scenario="step")) as session:
        steps = [step for step in session.run(seconds=0.26) if step.surface is not None]
        titles = _titles(session)
    assert steps[-1].state is zm.State.NULLING
    assert session.result.shown is not None
    assert session.result.shown.number == steps[-1].number
    assert next(title for title in titles if title.startswith("read: ")).count("nulling") == 1


def test_what_came_and_what_fingers_did_are_drawn() -> None:
    axes = Figure().subplots(3)
    known = {"sigma_height_mm": 0.1, "sigma_contact_s": 0.01, "sigma_x_mm": 0.1, "sigma_y_mm": 0.1}
    came = [
        Approach(
            watching=Watching.COMING, time_ns=k * 10**8, height_mm=50.0 - k, contact_s=1.0 - 0.1 * k,
            x_mm=40.0, y_mm=1.0, **known,
        )
        for k in range(5)
    ]  # fmt: skip
    draw_approaches(axes, [Approach(watching=Watching.CLEAR), *came, *came], 0)
    assert [len(line.get_xdata()) for axis in axes for line in axis.lines] == [5, 5]
    assert np.ptp(np.asarray(axes[1].lines[0].get_ydata())) == pytest.approx(0.0)
    draw_approaches(axes := Figure().subplots(3), [Approach(watching=Watching.CLEAR)], 0)
    assert [axis.texts[0].get_text() for axis in axes] == ["nothing came", "never armed", "never armed"]
    pointers = Pointers(load_rig("interactive").projector)
    finger = replace(round_contact().figures, id=3, force_n=0.4, sigma_force_n=0.002)
    draw_pointers(axes := Figure().subplots(3), pointers.follow([finger], 10**9), 0, 3 * 10**9)
    # until it is lifted it is where it was
    assert np.asarray(axes[1].lines[0].get_xdata()).tolist() == [1.0, 3.0]
    assert np.asarray(axes[1].lines[0].get_ydata()).tolist() == pytest.approx([0.4, 0.4])


def test_the_true_depth_is_not_drawn_across_a_hole() -> None:
    read = surface(outwards(ball, 0.02), (0.0, 0.0))
    row = int(np.unravel_index(np.argmax(np.abs(read.depth_mm) * read.valid), read.valid.shape)[0])
    hole = np.flatnonzero(read.valid[row])[3:6]
    read.valid[row, hole] = False
    truth: Any = SimpleNamespace(depth=lambda x_mm, y_mm: 1e-3 * np.hypot(x_mm, y_mm))
    axis = Figure().subplots()
    _section(axis, read, truth)
    line = next(line for line in axis.lines if line.get_label() == "truth")
    drawn = np.asarray(line.get_ydata())
    assert np.isnan(drawn[hole]).all()
    assert np.isfinite(drawn[read.valid[row]]).all()


def test_the_title_compares_the_peak_with_the_deepest_true_point() -> None:
    """Under a ball nothing can be read: the nodes that are read may be perfect and the peak far off."""
    # pixels too coarse for coded pictures, which the loop would wait for
    rig = coarser(load_rig("simulated"), 8).replace({"control.burst": "never"}, scenario="ball")
    with zm.Session(rig) as session:
        for step in session.run(seconds=1.2):
            assert step.number > 0
    figures = summarise(session.result)
    truth, read_mm = figures["truth"], figures["depth_peak_mm"]
    # the ball's own deepest point is deeper than all that reflects
    assert truth["depth_deepest_mm"] > 1.1 * truth["depth_peak_mm"] > 0.0
    error = 100 * (read_mm / truth["depth_deepest_mm"] - 1)
    assert f"true {truth['depth_deepest_mm']:.5f} mm ({error:+z.2f} %)" in _title(figures)
    assert np.isfinite(error)


def test_the_pressure_on_the_largest_contact_is_drawn_where_the_modulus_is_known() -> None:
    pressed = surface(outwards(ball, 0.02), (0.0, 0.0))
    nulled: Any = SimpleNamespace(surface=pressed, contacts=(round_contact(),))
    titled, said = "maximum [0-9.]+ ± [0-9.]+ kPa", r"rubber\.youngs_modulus_mpa"
    for rubber, panels, words in (({}, 2, titled), ({"youngs_modulus_mpa": None}, 1, said)):
        figure = Figure()
        # with a scale of its own beside it
        _draw_pressure(figure.subplots(), SimpleNamespace(rig=rig(**rubber)), nulled)  # type: ignore[arg-type]
        assert len(figure.axes) == panels
        axis = figure.axes[0]
        assert re.search(words, " ".join([axis.get_title(), *(text.get_text() for text in axis.texts)]))


def test_a_peak_that_is_right_to_all_digits_is_not_minus_nothing() -> None:
    figures = {"rig": "r", "scenario": "p", "controller": "c", "read_until_s": None}
    figures |= {"depth_peak_mm": 0.1999999, "depth_peak_sigma_mm": 1e-5}
    truth = {"depth_deepest_mm": 0.2, "depth_rms_error_um": 0.001}
    assert "(+0.00 %)" in _title({**figures, "truth": truth})


@pytest.mark.parametrize(("extreme", "ends"), [(1.0, "neither"), (9.0, "max"), (-9.0, "min")])
def test_a_scale_says_where_values_lie_beyond_its_end(extreme: float, ends: str) -> None:
    values = np.array([[0.5, -0.5, np.nan, extreme]])
    figure = Figure()
    axis = figure.subplots()
    colour_bar(axis, axis.pcolormesh(values, vmin=-1.0, vmax=1.0), "mm")
    bar = axis.collections[0].colorbar
    assert bar is not None
    assert bar.extend == ends
