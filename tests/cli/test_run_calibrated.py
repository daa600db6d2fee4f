"""`run` on a rig file that a calibration has made."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

from command_line import run
from commands import assert_refused, typed
from small_rigs import BENCH_160, small_rig_file

from zeromethod.calibration.folder import DOCUMENT, RIG, SCHEMA_VERSION
from zeromethod.cli.check import check_command


def calibrated(folder: Path, exposure_s: float, days_ago: float) -> Path:
    """Rig file of a calibration made at this exposure."""
    rig = small_rig_file(folder / RIG, BENCH_160)
    time = (datetime.now(UTC) - timedelta(days=days_ago)).isoformat()
    (folder / DOCUMENT).write_text(
        f"schema_version = {SCHEMA_VERSION!r}\ntime = {time}\n"
        f"[parameters]\n[verdict]\n[fingerprint.camera]\nexposure_s = {exposure_s}\n"
    )
    return rig


def outcome(rig: Path, *more: str) -> tuple[int, str]:
    code, _, err = run("run --scenario none --frames 6 --rig", rig, *more)
    return code, err


def test_a_calibration_of_another_bench_is_refused_unless_forced(tmp_path):
    rig = calibrated(tmp_path, 0.004, days_ago=0)
    code, said = outcome(rig)
    assert code == 2
    assert said.startswith(f"zeromethod: --rig: {rig}: exposure, s: calibrated with 0.004, now 0.008: ")
    assert "--force" in said
    assert outcome(rig, "--force") == (0, "")


def test_a_real_benchs_calibration_asks_for_its_devices(tmp_path):
    rig = calibrated(tmp_path, 0.008, days_ago=0)
    with (tmp_path / DOCUMENT).open("a") as document:
        document.write('driver = "opencv"\n[fingerprint.display]\ndriver = "window"\n')
    words = "calibrated with real devices: give --display N and --camera ADDRESS, or --simulate"
    assert outcome(rig) == (2, f"zeromethod: --rig: {rig}: {words}\n")
    assert outcome(rig, "--simulate") == (0, "")


def test_a_simulated_bench_is_not_checked_in_place_of_the_calibrated_one(tmp_path):
    rig = calibrated(tmp_path, 0.008, days_ago=0)
    with (tmp_path / DOCUMENT).open("a") as document:
        document.write('driver = "opencv"\n[fingerprint.display]\ndriver = "window"\n')
    refused = typed(check_command, "--rig", rig)
    assert_refused(refused, f"{rig}: calibrated with real devices: give --display N and --camera ADDRESS")
    assert not list(tmp_path.rglob("checks.csv"))


def test_the_simulated_twin_needs_no_measured_rest(tmp_path):
    rig = small_rig_file(tmp_path / "moved.toml", BENCH_160)
    rig.write_text(rig.read_text().replace("[camera]\n", '[camera]\nrest_map = "arrays.h5"\n', 1))
    code, said = outcome(rig)
    assert code == 2
    assert "camera.rest_map" in said
    assert outcome(rig, "--simulate") == (0, "")


def test_an_old_calibration_is_warned_of(tmp_path):
    code, said = outcome(calibrated(tmp_path, 0.008, days_ago=400))
    assert code == 0
    assert said.startswith("! ")
    assert "400 days" in said
