"""Speed of this computer on a rig's frames: what is measured, and what the verdict rests on."""

import pytest
from recorded_run import small_rig
from small_rigs import with_tables

from zeromethod.errors import MeasurementError
from zeromethod.session import speed
from zeromethod.session.speed import FRAMES, STEPS, WARM_UP_FRAMES, measure_speed, percentiles


@pytest.fixture(autouse=True)
def _short_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "RECORDING_S", 0.5)


def test_every_part_is_held_against_the_rate_of_the_camera(tmp_path):
    rig, words = small_rig(), []
    figures = measure_speed(rig, tmp_path, words.append)
    parts, rate_hz = figures["parts"], figures["camera_rate_hz"]
    assert list(parts) == ["loop", "drawing", "reading", "recording"]
    assert (len(words), words[-1]) == (STEPS, "")
    assert figures["frames"] == FRAMES - WARM_UP_FRAMES
    for name in ("loop", "drawing", "reading"):
        ms = parts[name]["ms"]
        assert 0.0 < ms["median"] <= ms["p90"] <= ms["p99"]
        assert parts[name]["frames_per_s"] == pytest.approx(1e3 / ms["p90"])
    for part in parts.values():
        assert part["fast_enough"] == (part["frames_per_s"] >= rate_hz)
        assert part["share_of_frame"] == pytest.approx(rate_hz / part["frames_per_s"])
    assert figures["fast_enough"] == all(part["fast_enough"] for part in parts.values())
    slowest = min(part["frames_per_s"] for part in parts.values())
    assert parts[figures["bottleneck"]]["frames_per_s"] == slowest
    # whole frames are recorded, and no file is left
    recording, image_mb = parts["recording"], rig.camera.columns * rig.camera.rows / 1e6
    assert recording["megabytes_per_s"] > recording["frames_per_s"] * image_mb
    assert recording["trouble"] == ""
    assert list(tmp_path.iterdir()) == []


def test_a_bench_without_light_is_not_timed(tmp_path):
    dark = with_tables(small_rig(), simulation={"peak_grey_share": 1e-6})
    with pytest.raises(MeasurementError, match="was not measured"):
        measure_speed(dark, tmp_path, lambda _: None)


def test_percentiles_are_of_what_is_finite():
    assert percentiles([1.0, float("nan"), 3.0])["median"] == 2.0
    assert percentiles([float("nan")]) == {"median": None, "p90": None, "p99": None}
