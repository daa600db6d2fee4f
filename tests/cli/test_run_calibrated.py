"""`run` on a rig file that a calibration has made."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from small_rigs import BENCH_160, small_rig_file

from zeromethod.calibration.folder import DOCUMENT, RIG, SCHEMA_VERSION
from zeromethod.cli.main import main


def calibrated(folder: Path, exposure_s: float, days_ago: float) -> str:
    """Rig file of a calibration made at this exposure."""
    rig = small_rig_file(folder / RIG, BENCH_160)
    time = (datetime.now(UTC) - timedelta(days=days_ago)).isoformat()
    (folder / DOCUMENT).write_text(
        f"schema_version = {SCHEMA_VERSION!r}\ntime = {time}\n"
        f"[parameters]\n[verdict]\n[fingerprint.camera]\nexposure_s = {exposure_s}\n"
    )
    return str(rig)


def outcome(*arguments: str, capsys: pytest.CaptureFixture[str]) -> tuple[int | str | None, str]:
    with pytest.raises(SystemExit) as ended:
        main(["run", "--scenario", "none", "--frames", "6", *arguments])
    return ended.value.code, capsys.readouterr().err


def test_a_calibration_of_another_bench_is_refused_unless_forced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = calibrated(tmp_path, 0.004, days_ago=0)
    code, told = outcome("--rig", rig, capsys=capsys)
    assert code == 2
    assert told.startswith(f"zeromethod: --rig: {rig}: exposure, s: calibrated with 0.004, now 0.008: ")
    assert "--force" in told
    assert outcome("--rig", rig, "--force", capsys=capsys) == (0, "")


def test_a_real_benchs_calibration_asks_for_its_devices(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = calibrated(tmp_path, 0.008, days_ago=0)
    with (tmp_path / DOCUMENT).open("a") as document:
        document.write('driver = "opencv"\n[fingerprint.display]\ndriver = "window"\n')
    words = "calibrated with real devices: give --display N and --camera ADDRESS, or --simulate"
    assert outcome("--rig", rig, capsys=capsys) == (2, f"zeromethod: --rig: {rig}: {words}\n")
    assert outcome("--rig", rig, "--simulate", capsys=capsys) == (0, "")


def test_the_simulated_twin_needs_no_measured_rest(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = small_rig_file(tmp_path / "moved.toml", BENCH_160)
    rig.write_text(rig.read_text().replace("[camera]\n", '[camera]\nrest_map = "arrays.h5"\n', 1))
    code, told = outcome("--rig", str(rig), capsys=capsys)
    assert code == 2
    assert "camera.rest_map" in told
    assert outcome("--rig", str(rig), "--simulate", capsys=capsys) == (0, "")


def test_an_old_calibration_is_told_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, told = outcome("--rig", calibrated(tmp_path, 0.008, days_ago=400), capsys=capsys)
    assert code == 0
    assert told.startswith("! ")
    assert "400 days" in told
