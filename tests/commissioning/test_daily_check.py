"""The check at the start of a day, on simulated benches that stand otherwise than they were calibrated."""

import csv
import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from small_rigs import with_tables

from zeromethod import MeasurementError, Rig, check_bench, open_devices
from zeromethod.commissioning.calibration.prompts import Silent
from zeromethod.commissioning.daily_check import check
from zeromethod.commissioning.daily_check.findings import DailyCheck, Finding, Fitness, Subject
from zeromethod.commissioning.daily_check.log import COLUMNS, append_check, log_of
from zeromethod.commissioning.daily_check.rest import depth_percent_per_px

from .calibration.planted import Hand, nominal
from .setting_up_benches import Altered

RIG = nominal()
MIDDLE_MM = (40.0, 0.0)


@pytest.fixture(autouse=True, scope="module")
def _short() -> Iterator[None]:
    """What is seen in a moment on a bench that has no noise of its own to average."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("LOOK_S", 0.2), ("DELAY_S", 0.4), ("REST_FRAMES", 16), ("PATIENCE_S", 1.0)):
            patch.setattr(check, name, value)
        yield


def checked(
    truth: Rig, believed: Rig = RIG, press_mm: float | None = None, true_mm: float = 0.1
) -> DailyCheck:
    """The check of a bench that stands as `truth`, by one who believes `believed`."""
    with open_devices(truth) as devices:
        hand = Hand(devices, [true_mm], [MIDDLE_MM])
        return check_bench(believed, devices, press_depth_mm=press_mm, prompts=hand)


def of(found: DailyCheck, subject: Subject) -> Finding:
    return next(one for one in found.findings if one.subject is subject)


@pytest.fixture(scope="module")
def untouched() -> DailyCheck:
    return checked(RIG, press_mm=0.1)


def test_a_bench_as_it_was_calibrated_is_good(untouched):
    assert untouched.fitness is Fitness.GOOD, untouched.verdict
    assert [one.subject for one in untouched.findings] == list(Subject)[1:]
    assert untouched.figures["press_read_mm"] == pytest.approx(
        0.1, abs=3 * untouched.figures["press_sigma_mm"]
    )


def test_a_camera_that_turned_is_a_drift_with_its_false_depth():
    aim_mm = (RIG.camera.look_at_mm[0] + 0.02, *RIG.camera.look_at_mm[1:])
    found = of(checked(with_tables(RIG, camera={"look_at_mm": aim_mm})), Subject.REST)
    assert found.fitness is Fitness.DRIFTED
    assert "re-zero" in found.words
    assert "camera turned sideways" in found.words


def test_a_bench_that_moved_far_is_to_be_calibrated_again():
    centre_mm = (RIG.display.centre_mm[0] + 0.6, RIG.display.centre_mm[1])
    # on the finer LCD: the coarse one's picture is too dim there to be measured at all
    found = checked(with_tables(nominal(2), display={"centre_mm": centre_mm}), nominal(2))
    assert found.fitness is Fitness.RECALIBRATE
    assert found.worst.subject is Subject.REST


def test_a_late_display_is_reported_with_its_delay():
    found = of(checked(with_tables(RIG, display={"latency_s": 0.01})), Subject.DELAY)
    assert found.fitness is Fitness.DRIFTED
    # bar: what the delay's own test allows, a hundredth of a frame
    assert found.figures["delay_change_ms"] == pytest.approx(10.0, abs=0.17)


@pytest.mark.parametrize(("strips", "fitness"), [("edges", Fitness.GOOD), ("none", Fitness.DRIFTED)])
def test_a_delay_that_is_not_steady_is_judged_by_what_it_does_to_depth(strips, fitness):
    """Stamps off by up to 24 ms either way, as on a busy computer; strips time every frame all the same."""
    rng = np.random.default_rng(3)
    rig = with_tables(RIG, control={"strips": strips})
    with open_devices(RIG) as devices:
        camera = devices.camera
        devices.camera = Altered(
            camera,
            read=lambda timeout_s: replace(
                frame := camera.read(timeout_s), time_ns=frame.time_ns + round(1e6 * rng.uniform(-24, 24))
            ),
        )
        found = check_bench(rig, devices)
    delay = of(found, Subject.DELAY)
    assert delay.fitness is fitness, found.verdict
    # uniform over 48 ms: 1.48 times the median deviation of 12 ms, of some 24 frames
    assert delay.figures["delay_scatter_ms"] == pytest.approx(17.8, abs=9)
    assert re.search(
        r"computer too busy\?; .* moves by 1 mm/s is read up to \d+ µm off in depth$", delay.words
    )


def test_a_press_that_reads_wrong_asks_for_a_calibration():
    found = checked(RIG, press_mm=0.11, true_mm=0.1)
    assert found.fitness is Fitness.RECALIBRATE
    assert found.worst.subject is Subject.PRESS
    assert found.figures["press_error_percent"] == pytest.approx(-100 / 11, abs=1.0)


def test_a_dark_bench_is_not_fit_to_measure():
    dark = with_tables(RIG, simulation={"peak_grey_share": 0.05})
    assert of(checked(dark), Subject.LIGHT).fitness is Fitness.UNFIT


def test_a_lost_camera_ends_the_check_with_its_reason():
    lost = RIG.replace({"simulation.faults.camera_lost_at_frame": 40})
    with pytest.raises(MeasurementError, match="the camera is lost"):
        checked(lost)


def test_a_camera_lost_while_the_loop_runs_says_nothing_about_the_calibration():
    found = checked(RIG.replace({"simulation.faults.camera_lost_at_frame": 195}))  # as the rest is taken
    rest = of(found, Subject.REST)
    assert rest.fitness is found.fitness is Fitness.UNFIT
    assert "the camera is lost" in rest.words


def test_where_no_frame_came_frames_are_not_good():
    none = check._Check(RIG, None, Silent())._frames(check._Frames())
    assert none.fitness is Fitness.UNFIT


def test_what_is_left_after_re_zeroing_is_that_of_a_traced_press():
    percent = depth_percent_per_px(RIG)
    assert np.isfinite(percent).all()
    # between nothing and what a millimetre between LCD and P0 does, 5 %, with room for other places
    assert (percent > 1e-4).all()
    assert (percent < 10).all()


def test_every_check_is_a_line_of_one_table(tmp_path, untouched):
    path = tmp_path / "made" / "checks.csv"
    for _ in range(2):
        append_check(path, untouched)
    with path.open() as file:
        rows: list[dict[str, Any]] = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == 2
    assert rows[0]["fitness"] == "good"
    assert float(rows[1]["press_read_mm"]) == pytest.approx(untouched.figures["press_read_mm"], rel=1e-5)
    assert set(untouched.figures) <= set(COLUMNS)
    # a table that another version began keeps its columns
    path.write_text("time,fitness\n")
    append_check(path, untouched)
    assert path.read_text().splitlines()[1].endswith(",good")


def test_the_table_lies_where_calibrations_go(tmp_path):
    rig_file = tmp_path / "mine.toml"
    rig_file.touch()
    assert log_of(rig_file) == tmp_path / "calibrations" / "mine" / "checks.csv"
