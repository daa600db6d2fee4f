"""`zeromethod measure` as a person meets it: files, table, and depth with a rig."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from command_line import run
from small_rigs import BENCH_320, small_rig_file

from zeromethod.rig.load import load_rig
from zeromethod.simulation.numpy_renderer import NumpyRenderer
from zeromethod.simulation.press import Dent, Mirror, Shape
from zeromethod.simulation.renderer import Piece
from zeromethod.simulation.sensor import Sensor

PLANTED_MM = 0.05


def speckle(shape: tuple[int, int], sigma_px: float, seed: int = 3) -> np.ndarray:
    grey = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=shape), (0, 0), sigma_px)
    return np.clip(128 + 45 * grey / grey.std(), 0, 255).astype(np.uint8)


def write(path: Path, image: np.ndarray) -> Path:
    cv2.imencode(path.suffix, image)[1].tofile(path)
    return path


@pytest.fixture
def shifted(tmp_path: Path) -> tuple[Path, Path]:
    """Reference and an image whose content moved right by 3 and down by 2 px."""
    big = speckle((140, 160), 2.0)
    return write(tmp_path / "rest.bmp", big[10:130, 10:150]), write(
        tmp_path / "moved é.png", big[8:128, 7:147]
    )


def test_files_table_and_summary_give_the_planted_shift(shifted, tmp_path):
    folder, summary = tmp_path / "results", tmp_path / "summary.json"
    code, out, err = run("measure", *shifted, "--output", folder, "--summary", summary)
    assert (code, err) == (0, "")
    assert "moved" in out
    assert "median shift" in out
    assert (folder / "moved é.png").read_bytes().startswith(b"\x89PNG")
    with np.load(folder / "moved é.npz") as data:
        assert {data[name].shape for name in ("u", "v", "du", "dv", "sigma", "valid")} == {(24, 28)}
        # Whole pixels of the same picture: nothing but the window's rims can err.
        assert np.median(data["du"][data["valid"]]) == pytest.approx(3.0, abs=0.005)
        assert np.median(data["dv"][data["valid"]]) == pytest.approx(2.0, abs=0.005)
        assert data["valid"].mean() > 0.8
    (image,) = json.loads(summary.read_text())["images"]
    assert image["displacement_median_px"] == pytest.approx(np.hypot(3, 2), abs=0.01)
    assert image["valid_share"] > 0.8


def test_colour_and_sixteen_bits_are_read_as_grey(shifted, tmp_path):
    reference, moved = (cv2.imdecode(np.fromfile(path, np.uint8), 0) for path in shifted)
    colour = write(tmp_path / "colour.tif", np.repeat(reference[..., None], 3, axis=-1))
    deep = write(tmp_path / "deep.tif", moved.astype(np.uint16) * 256)
    summary = tmp_path / "summary.json"
    assert run("measure", colour, deep, "--summary", summary)[0] == 0
    (image,) = json.loads(summary.read_text())["images"]
    assert image["displacement_median_px"] == pytest.approx(np.hypot(3, 2), abs=0.01)


def test_an_image_without_anything_to_find_ends_with_1_after_the_rest_was_written(shifted, tmp_path):
    blank = write(tmp_path / "blank.png", np.full((120, 140), 90, np.uint8))
    folder = tmp_path / "results"
    code, out, err = run("measure", shifted[0], blank, shifted[1], "--output", folder)
    assert code == 1
    assert "blank" in err
    assert "moved" in out
    assert {path.name for path in folder.iterdir()} == {
        "blank.npz",
        "blank.png",
        "moved é.npz",
        "moved é.png",
    }


def test_a_texture_that_repeats_ends_with_1_and_advice(tmp_path):
    v, u = np.mgrid[:160, :200]
    for name, moved in (("rest", 0), ("moved", 5)):
        grey = 120 + 40 * np.cos(np.pi / 8 * (u - moved)) + 40 * np.cos(np.pi / 8 * v)
        write(tmp_path / f"{name}.png", np.rint(grey).astype(np.uint8))
    code, _, err = run("measure", tmp_path / "rest.png", tmp_path / "moved.png")
    assert code == 1
    assert "the texture repeats" in err
    assert "speckle" in err


@pytest.fixture(scope="module")
def press(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, Path]:
    """A rig file, and what its camera sees at rest and under a dent of 0.05 mm."""
    folder = tmp_path_factory.mktemp("press")
    path = small_rig_file(folder / "small.toml")
    rig = load_rig(str(path))
    dent = Dent(Shape.GAUSSIAN, x_mm=34.0, y_mm=0.0, depth_mm=PLANTED_MM, size_mm=4.0)
    renderer, sensor = NumpyRenderer(rig), Sensor(rig)
    # A camera pixel sees about two LCD pixels: specks of two camera pixels.
    handle = renderer.upload(speckle((rig.display.rows, rig.display.columns), 4.0))
    share = np.ones(rig.display.rows, np.float32)
    images = []
    for number, (name, mirror) in enumerate([("rest", Mirror(())), ("pressed", Mirror((dent,)))]):
        light = renderer.expose([Piece(1.0, mirror, [(handle, share)])])
        images.append(write(folder / f"{name}.png", sensor.image(light, number)))
    return path, images[0], images[1]


def test_depth_by_a_rig_that_was_not_calibrated_is_relative(press, tmp_path):
    rig, *images = press
    options = "--rig", rig, "--output", tmp_path / "out", "--summary", tmp_path / "summary.json"
    code, out, err = run("measure", *images, *options)
    assert code == 1
    assert "relative" in out
    # On a new machine, what is compiled is said before.
    assert f"! {rig}: not calibrated: depth is relative" in err
    assert "zeromethod calibrate" in err
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["calibrated"] is False
    # Without a measured rest nothing of depth is known: its sigma is as large as itself.
    (image,) = summary["images"]
    assert image["depth_peak_sigma_mm"] > 0.9 * image["depth_peak_mm"]
    with np.load(tmp_path / "out" / "pressed.npz") as data:
        assert not data["calibrated"]


def test_a_rig_turns_a_static_texture_into_the_depth_of_a_press(press, tmp_path):
    _, *images = press
    path = small_rig_file(tmp_path / "exact.toml", {**BENCH_320, "geometry.known": "exact"})
    options = "--rig", path, "--output", tmp_path / "out", "--summary", tmp_path / "summary.json"
    code, out, err = run("measure", *images, *options)
    assert (code, err) == (0, "")
    assert "peak depth" in out
    (image,) = json.loads((tmp_path / "summary.json").read_text())["images"]
    with np.load(tmp_path / "out" / "pressed.npz") as data:
        valid = data["depth_valid"]
        r2 = (data["x_mm"] - 34.0) ** 2 + data["y_mm"] ** 2
        truth = PLANTED_MM * np.exp(-r2 / (2 * 4.0**2))
        error = (data["depth_mm"] - truth)[valid]
        assert data["node_u"].shape == valid.shape
        sigma = data["sigma_depth_mm"][valid]
    # Noise, the anchor (no rim in view) and what lens and specks average are in sigma.
    bound_mm = 3.0 * image["depth_peak_sigma_mm"]
    assert bound_mm < 0.2 * PLANTED_MM
    assert abs(image["depth_peak_mm"] - PLANTED_MM) < bound_mm
    assert np.sqrt(np.mean(error**2)) < 0.02 * PLANTED_MM + 2.0 * np.sqrt(np.mean(sigma**2))
