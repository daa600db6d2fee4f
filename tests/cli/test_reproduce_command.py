"""`zeromethod reproduce`: one quick run, its figures against the bars, its pictures."""

import json
from types import SimpleNamespace

import pytest
from command_line import run


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("reproduce")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "120")
        outcome = run("reproduce --quick --output", folder / "pictures", "--summary", folder / "figures.json")
    figures = json.loads((folder / "figures.json").read_text())
    return SimpleNamespace(**outcome._asdict(), folder=folder / "pictures", figures=figures)


def test_the_papers_method_is_wrong_by_about_what_the_paper_says(done):
    # Section 5: "approximately 10 percent at the peak area".
    assert 5.0 <= abs(done.figures["press"]["whole_pixel_picks"]["peak_error_percent"]) <= 20.0


def test_the_zero_method_reads_the_same_press_within_three_tenths_of_a_percent(done):
    press = done.figures["press"]
    assert abs(press["zero_method"]["peak_error_percent"]) <= 0.3
    assert press["zero_method"]["view_rms_um"] < press["whole_image"]["view_rms_um"]


def test_each_column_is_better_than_the_one_before(done):
    names = ("whole_pixel_picks", "sub_pixel_picks", "whole_image", "zero_method")
    errors = [done.figures["press"][name]["line_rms_um"] for name in names]
    assert errors == sorted(errors, reverse=True)


def test_all_figures_of_the_paper_are_drawn_where_it_says(done):
    assert done.code == 0, done.out
    assert f"pictures: {done.folder}" in done.out
    names = {path.name for path in done.folder.glob("*.png")}
    assert {f"figure-{number}.png" for number in (13, 14, 15)} <= names
    assert len(names) == 8, "and 5 to 9"
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in done.folder.glob("*.png"))


def test_the_table_holds_what_the_summary_does(done):
    zero = done.figures["press"]["zero_method"]
    assert f"{zero['peak_error_percent']:+.3f}" in done.out
    assert f"{done.figures['press']['whole_pixel_picks']['peak_mm']:.5f}" in done.out
