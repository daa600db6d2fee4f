"""The page of a recording: true to the tables, whole in itself, whatever is missing."""

import os
import re
import shutil
import time
import warnings
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import h5py
import numpy as np
import pytest
import tomlkit
from report_page import HOSTILE, Page, add_row

from zeromethod import load_rig
from zeromethod.recording.recording import Recording
from zeromethod.view import report_figures
from zeromethod.view.report import STEPS, key_steps, write_report
from zeromethod.view.report_summary import summarise_recording
from zeromethod.view.report_words import peak_words, rig_rows
from zeromethod.view.table import force_words

Edited = Callable[[Callable[[h5py.File], object]], Path]


def page_of(path: Path) -> Page:
    output = path.with_suffix(".html")
    with Recording(path) as recording:
        write_report(recording, path, output)
    return Page(output.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def page(recording_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Of the recording as it was made."""
    return page_of(Path(shutil.copy(recording_path, tmp_path_factory.mktemp("page") / "press.h5")))


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are made but not rendered, which takes longer than all the rest of a page."""
    empty = '<svg role="img" aria-label="{}"></svg>'
    monkeypatch.setattr(report_figures, "_svg", lambda _, words: empty.format(words))


def test_page_is_whole_in_itself(page):
    assert {"h1", "table", "svg", "details"} <= set(page.tags)
    assert not {"script", "link", "iframe", "object", "embed"} & set(page.tags)
    assert page.refers
    assert all(one.strip("'\"").startswith(("data:image/png;base64,", "#")) for one in page.refers)
    assert "@import" not in page.source
    assert len(page.ids) == len(set(page.ids))


def test_frames_that_are_not_read_are_not_called_drops(recording_path, page):
    with Recording(recording_path) as recording:
        figures = summarise_recording(recording)
    # the loop starts on a panel that is not lit yet
    assert figures["without_reading"]["picture not lit yet"] > 0
    assert figures["dropped"] == {}
    assert "no new reading: picture not lit yet" in page.text
    assert "frames dropped none" in page.text
    assert "items damaged none" in page.text


@pytest.mark.usefixtures("undrawn")
def test_every_text_from_the_recording_is_escaped(edited):
    def fill(file: h5py.File) -> None:
        file.attrs["command_line"] = f"zeromethod run {HOSTILE}"
        file.attrs["gl_renderer"] = HOSTILE
        row = {"step": 6, "time_ns": file["steps/table"]["time_ns"][5]}
        add_row(file, "notes", **row, text=f"note {HOSTILE}".encode())
        add_row(file, "drops", **row, count=2, lost_by=b"camera", reason=f"why {HOSTILE}".encode())

    page = page_of(edited(fill))
    assert "script" not in page.tags
    for said in (f"{HOSTILE}: edited.h5", f"zeromethod run {HOSTILE}", f"note {HOSTILE}", f"why {HOSTILE}"):
        assert said in page.text


def test_figures_are_those_of_the_tables_and_of_the_planted_press(recording_path):
    with Recording(recording_path) as recording:
        figures = summarise_recording(recording)
        steps, peaks = recording.steps, recording.peaks
        names = [str(recording.state_of(row)) for row in steps]
    assert figures["complete"]
    assert figures["frames"] == np.count_nonzero(steps["frame_number"] >= 0)
    # a steady 60 per second, but for the jitter of a simulated clock
    assert figures["rate_hz"] == pytest.approx(60.0, rel=0.01)
    nulled = np.isin(names, ["locked", "resting"])
    held_s = 1e-9 * np.diff(steps["time_ns"])
    assert figures["locked_share"] == pytest.approx(held_s[nulled[:-1]].sum() / held_s.sum())
    assert sum(figures["shares"].values()) == pytest.approx(1.0)
    assert figures["residual_px_rms"]["median"] == np.median(steps["residual_rms_px"][nulled])
    # the press is 0.2 mm deep; nodes four times as far apart as in full resolution cost up to 1 %, and what
    # the press leaves at the view's end another 1 % until it is learned
    largest = figures["largest"]
    assert largest["depth_mm"] == pytest.approx(0.2, rel=0.02)
    assert largest["state"] == "locked"
    assert largest["depth_mm"] == peaks["depth_mm"][np.isin(peaks["step"], steps["number"][nulled])].max()


def test_depth_is_shown_when_first_locked_at_its_largest_and_at_the_end(recording_path):
    with Recording(recording_path) as recording:
        shown = key_steps(recording)
        locked = [int(row["number"]) for row in recording.steps if str(recording.state_of(row)) == "locked"]
        names = {name: step for step, names in shown.items() for name in names}
        assert names["first locked"] == locked[0]
        assert names["largest |depth|"] == summarise_recording(recording)["largest"]["step"]
        assert names["last"] == recording.steps_with("surface")[-1]


def test_a_force_is_given_to_the_first_digit_of_its_sigma():
    assert force_words(0.0353, 0.0000281) == "0.03530 ± 0.00003 N"
    assert force_words(0.1497, 0.0038) == "0.1497 ± 0.0038 N"
    assert force_words(0.2, None) == "0.2000 N"


def test_the_bench_has_what_the_new_rigs_have_and_no_lcd_where_there_is_a_print():
    said = {name: dict(rig_rows(load_rig(name))) for name in ("interactive", "contactless", "printed")}
    assert {"projector", "cloth"} <= said["interactive"].keys()
    assert "two lenses 80 mm apart" in said["contactless"]["watch camera"]
    assert "LCD" not in said["printed"]


def test_peak_is_given_to_two_digits_of_its_sigma():
    peak = {"depth_mm": 0.2012345, "sigma_mm": 5.1e-5, "x_mm": 30.0, "y_mm": -1e-9, "time_s": 1.0}
    peak |= {"state": "locked", "where": "measured", "x_sigma_mm": 1e-3, "y_sigma_mm": float("nan")}
    assert peak_words(peak) == "201.234 ± 0.051 µm at x = 30.00, y = 0.00 mm, 1.00 s, locked"
    assert peak_words(peak | {"depth_mm": 1.5, "sigma_mm": 0.02}).startswith("1.500 ± 0.020 mm")
    assert peak_words(peak | {"sigma_mm": float("nan")}).startswith("201.234 µm (sigma not known)")
    calibrated = peak_words(peak | {"x_sigma_mm": 0.31, "y_sigma_mm": 1.1})
    assert "x = 30.00 ± 0.31, y = 0.00 ± 1.10 mm" in calibrated
    assert "mm, inside a contact, 1.00 s" in peak_words(peak | {"where": "inside a contact"})


def without_arrays(file: h5py.File) -> None:
    for name in ("surface", "frames", "residual"):
        del file[name]
    file.attrs["keep"] = ["warps"]


def without_rows(file: h5py.File) -> None:
    for name in ("steps", "peaks", "notes", "drops", "presentation_log"):
        file[f"{name}/table"].resize(0, axis=0)


def without_numbers(file: h5py.File) -> None:
    peaks, steps = file["peaks/table"][()], file["steps/table"][()]
    for name in ("depth_mm", "depth_sigma_mm", "x_mm", "y_mm"):
        peaks[name] = np.nan
    steps["residual_rms_px"] = np.nan
    file["peaks/table"][...], file["steps/table"][...] = peaks, steps


def damaged_surface(file: h5py.File) -> None:
    file["surface/depth_mm"][-1, 5, 5] = 7.0


MISSING = [
    (without_arrays, ["No depth maps: the surface was not kept", "not kept frames, residual, surface"], 1),
    (without_rows, ["No step of the loop is in this recording.", "No depth maps: no surface was read."], 0),
    (without_numbers, ["nothing was measured", "depth was never read"], 3),
]


@pytest.mark.parametrize(("change", "words", "pictures"), MISSING)
def test_what_is_missing_is_said_and_leaves_the_rest_of_the_page(edited, change, words, pictures):
    page = page_of(edited(change))
    for said in words:
        assert said in page.text
    assert page.tags.count("svg") == pictures


@pytest.mark.usefixtures("undrawn")
def test_a_damaged_surface_is_left_out_and_the_others_are_shown(recording_path, edited):
    page = page_of(edited(damaged_surface))
    for said in ("last: no depth map: ", "surface/depth_mm: damaged", "first locked"):
        assert said in page.text
    assert page.tags.count("svg") == 1 + depth_maps(recording_path) - 1


def depth_maps(path: Path) -> int:
    """Maps that a page shows next to the curves over time."""
    with Recording(path) as recording:
        return len(key_steps(recording))


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("text", ["verdict = ", "schema_version = 9\n[parameters]\n"])
def test_a_calibration_that_cannot_be_read_is_said_and_leaves_the_rest_of_the_page(
    recording_path, edited, text
):
    page = page_of(edited(lambda file: file.attrs.__setitem__("calibration", text)))
    assert "The calibration in this recording cannot be read." in page.text
    assert "peak of largest |depth|" in page.text
    assert page.tags.count("svg") == 1 + depth_maps(recording_path)


@pytest.mark.usefixtures("undrawn")
def test_recording_that_was_not_closed_says_so(edited):
    path = edited(lambda file: file["complete"].write_direct(np.array(0, np.uint8)))
    # so that it was written just now, however long the page takes
    os.utime(path, (time.time() + 3600,) * 2)
    assert "still being written" in page_of(path).text
    os.utime(path, (time.time() - 60,) * 2)
    assert "was cut off" in page_of(path).text


@pytest.mark.usefixtures("undrawn")
def test_peaks_and_surfaces_of_steps_that_were_not_flushed_do_no_harm(edited):
    path = edited(lambda file: file["steps/table"].resize(20, axis=0))
    page = page_of(path)
    with Recording(path) as recording:
        assert max(key_steps(recording)) <= recording.steps["number"][-1]
        assert summarise_recording(recording)["last"]["step"] <= recording.steps["number"][-1]
    assert "20 steps of the loop" in page.text


def document(made: datetime) -> str:
    """calibration.toml with all that its tables are made of."""
    rest = {"valid_share": 0.98, "sigma_column_median_px": 0.02, "sigma_row_median_px": 0.02}
    parameter = {"value": 0.4567, "sigma": 0.042, "given": 0.0, "given_sigma": 0.6, "unit": "deg"}
    return tomlkit.dumps(
        {
            "schema_version": 1,
            "time": made,
            "made_by": "zeromethod 0.1.0",
            "verdict": {"level": "uncertain", "reason": HOSTILE, "findings": [HOSTILE, "the lamp ages"]},
            "depth_error": {
                "percent": 1.54,
                "region": [{"name": "near P0", "x_mm": 9.0, "y_mm": 0.0, "percent": 2.14}],
            },
            "parameters": {"display.turn_deg": parameter | {"words": "the LCD's turn in its plane"}},
            "fit": {"chi2_per_freedom": 0.96},
            "rest_map": rest | {"reasons_px": {"dark": 0}},
            "fingerprint": {"camera": {"serial": "0042"}},
        }
    )


@pytest.mark.usefixtures("undrawn")
def test_calibration_is_shown_with_sigma_verdict_and_age(edited):
    def calibrate(file: h5py.File) -> None:
        started = datetime.fromisoformat(file.attrs["started_utc"]).astimezone(UTC)
        file.attrs["calibration"] = document((started - timedelta(days=40)).replace(microsecond=0))

    page = page_of(edited(calibrate))
    assert "script" not in page.tags
    assert f"uncertain: {HOSTILE}. 40.0 days old at the run, more than 30." in page.text
    assert "1.54 % (1 sigma, by geometry), 2.14 % at worst (near P0)" in page.text
    assert "the LCD's turn in its plane 0.000 0.457 0.042 deg" in page.text
    assert "also the lamp ages" in page.text


@pytest.mark.usefixtures("undrawn")
def test_an_interrupted_page_leaves_the_old_one(recording_path, tmp_path, monkeypatch):
    output = tmp_path / "page.html"
    output.write_text("before")
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with Recording(recording_path) as recording, pytest.raises(KeyboardInterrupt):
        write_report(recording, recording_path, output)
    assert output.read_text() == "before"


def without_sums(file: h5py.File) -> None:
    """Let what is changed here pass for what was written."""
    names: list[str] = []
    file.visit(names.append)
    for name in names:
        if name.endswith("/checksums"):
            del file[name]


def unread(file: h5py.File, rows: slice) -> None:
    """Make the surfaces in these rows such as a view that sees nothing of the mirror gives."""
    for name in ("depth_mm", "slope", "x_mm", "y_mm", "sigma_depth_mm", "sigma_slope"):
        file[f"surface/{name}"][rows] = np.nan
    file["surface/valid"][rows] = False
    without_sums(file)


@pytest.mark.parametrize("rows", [slice(-1, None), slice(None)], ids=["the last", "all"])
def test_surfaces_without_a_number_make_a_page(edited, rows):
    page = page_of(edited(lambda file: unread(file, rows)))
    assert page.source.count(">nothing was read<") == (1 if rows.start else page.tags.count("svg") - 1)


def test_surfaces_of_which_nothing_was_read_or_half_has_no_place_keep_their_maps(edited):
    def strike(file: h5py.File) -> None:
        file["surface/valid"][-1] = False
        for name in ("x_mm", "y_mm", "depth_mm"):
            values = file[f"surface/{name}"]
            values[-1, :, : values.shape[2] // 2] = np.nan
        without_sums(file)

    page = page_of(edited(strike))
    assert page.source.count(">nothing was read<") == 1
    assert page.tags.count("svg") >= 3


@pytest.mark.parametrize("steps", [1, 9, 10])
def test_a_short_recording_has_no_empty_curve(edited, steps):
    path = edited(lambda file: file["steps/table"].resize(steps, axis=0))
    with Recording(path) as recording:
        frames = np.count_nonzero(recording.steps["frame_number"] >= 0)
    page = page_of(path)
    said = f"No curve of frames per second: {frames} frames are too few for one (10 make it)."
    assert (said in page.text) == ("frames per second" not in page.source.split("</svg>")[0]) == (frames < 10)


def test_a_curve_within_a_decade_has_plain_numbers(edited):
    def narrow(file: h5py.File) -> None:
        steps = file["steps/table"][()]
        steps["residual_rms_px"] = np.linspace(0.0102, 0.0118, len(steps))
        file["steps/table"][...] = steps

    svg = page_of(edited(narrow)).source.split("</svg>")[0]
    assert "mathdefault" not in svg
    assert re.search(r">0\.01\d\d?</text>", svg)


@pytest.mark.usefixtures("undrawn")
def test_all_that_is_damaged_is_counted_though_no_map_shows_it(recording_path, edited, tmp_path):
    def strike(file: h5py.File) -> None:
        with Recording(recording_path) as whole:
            shown = key_steps(whole)
        hidden = [i for i, step in enumerate(file["surface/step"]) if step not in shown]
        # one surface in two of its arrays, one in a row; two frames
        file["surface/depth_mm"][hidden[0], 5, 5] = 7.0
        file["surface/slope"][hidden[0], 5, 5, 0] = 7.0
        table = file["surface/table"][hidden[1]]
        table["iterations"] += 1
        file["surface/table"][hidden[1]] = table
        for index in (3, 8):
            file["frames/image"][index, 0, 0] ^= 1

    path, steps = edited(strike), []
    with Recording(path) as recording, warnings.catch_warnings():
        warnings.simplefilter("error")
        figures = write_report(recording, path, tmp_path / "page.html", steps.append)
    assert figures["damaged"] == {"frames": 2, "surface": 2}
    assert steps == [*STEPS[1:], ""]
    page = Page((tmp_path / "page.html").read_text(encoding="utf-8"))
    assert "damaged: 2 frames, 2 surfaces left out: these are not what was written." in page.text
    assert "items damaged 2 frames, 2 surfaces left out" in page.text
    assert "damaged: surfaces 2 not what was written: left out" in page.text
    assert "no depth map" not in page.text
