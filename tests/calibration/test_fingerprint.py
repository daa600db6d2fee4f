"""A calibration belongs to one bench: what counts as another one."""

from typing import Any

import pytest
from small_rigs import with_tables

from zeromethod import Rig, load_rig
from zeromethod.calibration.fingerprint import WORDS, check, take_fingerprint


class Camera:
    serial = "24001"
    model = "acA1300"


class Display:
    name = "DP-1"


def changed(table: str, **values: Any) -> Rig:
    return with_tables(load_rig("simulated"), **{table: values})


@pytest.mark.parametrize(
    ("table", "key", "value", "words"),
    [
        ("camera", "exposure_s", 0.004, "exposure, s: calibrated with 0.008, now 0.004"),
        ("camera", "columns", 640, "camera columns: calibrated with 1280, now 640"),
        ("display", "driver", "window", "LCD driver: calibrated with simulated, now window"),
        ("display", "pitch_mm", 0.07, "LCD pitch, mm: calibrated with 0.063, now 0.07"),
        ("target", "period_px", 32, "period of the pattern, camera px: calibrated with 16, now 32"),
    ],
)
def test_what_differs_is_named_with_both_values(table, key, value, words):
    assert check(take_fingerprint(load_rig("simulated")), changed(table, **{key: value})) == [words]


def test_another_camera_and_lcd_of_the_same_kind_are_named():
    rig = load_rig("simulated")
    fingerprint = take_fingerprint(rig, Camera(), Display())
    other, monitor = Camera(), Display()
    other.serial, monitor.name = "24002", "DP-2"
    assert check(fingerprint, rig, other, monitor) == [
        "camera serial number: calibrated with 24001, now 24002",
        "LCD name: calibrated with DP-1, now DP-2",
    ]


def test_serial_asked_for_in_the_rig_file_counts_until_the_camera_states_its_own():
    rig = load_rig("simulated")
    asked = rig.replace({"camera.driver": "pylon", "camera.serial": "777"})
    assert take_fingerprint(asked)["camera"]["serial"] == "777"
    assert take_fingerprint(asked, Camera())["camera"]["serial"] == "24001"


def test_the_same_bench_fits_and_so_does_what_is_not_known_or_geometry():
    rig = load_rig("simulated")
    fingerprint = take_fingerprint(rig, Camera(), Display())
    assert check(fingerprint, rig, Camera(), Display()) == []
    assert check(fingerprint, rig) == []
    assert check(fingerprint, changed("camera", roll_deg=1.0)) == []


def test_every_entry_has_words():
    fingerprint = take_fingerprint(
        changed("camera", gain=1.0, pixel_format="Mono8", region_px=(0, 0, 1280, 1024)), Camera(), Display()
    )
    keys = {f"{table}.{key}" for table, values in fingerprint.items() for key in values}
    assert keys == set(WORDS)
