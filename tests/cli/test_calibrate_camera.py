"""`zeromethod calibrate board` and `calibrate intrinsics` as a person meets them."""

import json
import sys
import tomllib
from pathlib import Path
from types import ModuleType
from typing import Any

import charuco_pictures as pictures
import cv2
import numpy as np
import pytest
from click.testing import Result
from commands import assert_refused, typed
from small_rigs import small_rig_file

from zeromethod import InputError, load_rig
from zeromethod.calibration.camera_file import load_camera
from zeromethod.calibration.charuco import Board, NoView, View, board_of
from zeromethod.cli import calibrate_bench
from zeromethod.cli.calibrate import calibrate_command
from zeromethod.clock import Clock
from zeromethod.devices.protocols import CameraTimeout, Frame

BOARD, OTHER = "9x7:8:6", NoView.OTHER_BOARD
HELD, VIEWS = 3, 6
"""Frames for which the board is held still; poses."""


def calibrate(*arguments: object) -> Result:
    return typed(calibrate_command, *arguments)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder, rng = tmp_path_factory.mktemp("frames"), np.random.default_rng(11)
    paths = []
    for number, pose in enumerate(pictures.POSES_DEG[:VIEWS]):
        paths.append(folder / f"board{number}.png")
        cv2.imencode(".png", pictures.seen(pose, rng))[1].tofile(paths[-1])
    return paths


@pytest.fixture(scope="module")
def bare(frames: list[Path]) -> Path:
    """A picture without any board."""
    path = frames[0].parent / "bare.png"
    cv2.imencode(".png", np.full(pictures.SHAPE, 128, np.uint8))[1].tofile(path)
    return path


def test_pictures_give_a_file_with_the_camera(frames, bare, tmp_path):
    output, summary = tmp_path / "camera.toml", tmp_path / "camera.json"
    result = calibrate(
        "intrinsics", *frames, bare, "--board", BOARD, "--output", output, "--summary", summary
    )
    assert result.exit_code == 0, result.output
    assert f"bare.png: {NoView.NO_MARKERS}" in result.output
    assert f"zeromethod calibrate --intrinsics {output}" in result.output
    loaded = load_camera(output)
    assert loaded.shape == pictures.SHAPE
    focal, sigma = loaded.intrinsics.values[0], np.sqrt(loaded.intrinsics.covariance[0, 0])
    assert abs(focal - pictures.FOCAL_PX[0]) < 4 * sigma < 0.01 * focal
    document, figures = tomllib.loads(output.read_text()), json.loads(summary.read_text())
    assert document["values"][0] == pytest.approx(figures["values"]["fx"])
    assert figures["refused"] == {"bare.png": NoView.NO_MARKERS}


def test_what_cannot_be_is_refused_on_one_line(frames, bare, tmp_path):
    output = ("--board", BOARD, "--output", tmp_path / "camera.toml")
    small = tmp_path / "small.png"
    cv2.imencode(".png", np.zeros((20, 30), np.uint8))[1].tofile(small)
    for arguments, words in (
        ((*frames[:3], bare, *output), "3 of 4 show the board"),
        ((*frames[:3], bare, *output), f"bare.png: {NoView.NO_MARKERS}"),
        ((*frames, "nowhere.png", *output), "nowhere.png"),
        ((*frames, small, *output), "small.png: 30 x 20 px"),
        ((*frames, "--rig", "simulated", *output), "the rig's camera has 1280 x 1024"),
        ((*frames, "--camera", 0, *output), "--camera: FRAMES are given"),
        (output, "FRAMES: missing"),
        ((*frames, "--board", BOARD, "--output", tmp_path / "camera.txt"), ".toml"),
        ((*frames, *output, "--board", "9x7"), "COLUMNSxROWS:SQUARE"),
        ((*frames, *output, "--board", "4x3:8:6"), f"{', '.join(one.name for one in frames)}: {OTHER}"),
        ((*frames, *output, "--board", "11x6:8:6"), f"board5.png: {OTHER}"),
    ):
        result = calibrate("intrinsics", *arguments)
        assert_refused(result, words)
    assert list(tmp_path.iterdir()) == [small]


class HandheldCamera:
    """A camera before which somebody holds a board, each pose for a while, moving it in between."""

    serial = "board"

    def __init__(self, rows: int, columns: int, clock: Clock) -> None:
        self.shape, self.bits = (rows, columns), 8
        self._clock, self._read = clock, 0
        rng = np.random.default_rng(12)
        self._images = [pictures.seen(pose, rng) for pose in pictures.POSES_DEG[:VIEWS]]

    def read(self, timeout_s: float) -> Frame:
        pose, step = divmod(self._read, HELD + 1)
        self._read += 1
        self._clock.sleep_until_ns(self._clock.now_ns() + 20_000_000)
        if step == HELD:  # between two poses the board is out of sight
            return self._frame(np.full(self.shape, 60, np.uint8))
        if pose == 1 and step == 0:
            raise CameraTimeout("late")
        return self._frame(self._images[min(pose, VIEWS - 1)])

    def _frame(self, image: np.ndarray) -> Frame:
        return Frame(image, self._clock.now_ns(), 1_000_000, self._read)

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("wanted", "words"),
    [((VIEWS,), f"view 1 of {VIEWS} taken"), ((VIEWS + 1, "--patience", 0.5), "no new view within 0.5 s")],
)
def test_live_views_are_taken_where_the_board_stands_still_and_waited_for_so_long(
    wanted, words, tmp_path, monkeypatch
):
    module: Any = ModuleType("handheld")
    module.HandheldCamera = HandheldCamera
    monkeypatch.setitem(sys.modules, "handheld", module)
    values = {
        "camera.driver": "handheld:HandheldCamera",
        "camera.columns": pictures.SHAPE[1],
        "camera.rows": pictures.SHAPE[0],
        "scenario": "none",
    }
    rig, output = small_rig_file(tmp_path / "mine.toml", values), tmp_path / "camera.toml"
    result = calibrate("intrinsics", "--rig", rig, "--board", BOARD, "--output", output, "--views", *wanted)
    assert result.exit_code == 0, result.output
    assert words in result.output
    assert tomllib.loads(output.read_text())["views"] == VIEWS


def found_in(image: np.ndarray, board: Board) -> View:
    view = board.find("board", image)
    assert isinstance(view, View)
    return view


def physical_px_per_m(path: Path) -> int:
    data = path.read_bytes()
    at = data.index(b"pHYs") + 4
    assert data[at : at + 4] == data[at + 4 : at + 8]
    assert data[at + 8] == 1  # metres
    return int.from_bytes(data[at : at + 4], "big")


def test_printed_board_has_its_true_size_and_is_found(tmp_path):
    output = tmp_path / "board.png"
    result = calibrate("board", "--board", "12x9:10", "--dpi", 300, "--output", output)
    assert result.exit_code == 0, result.output
    assert "12 squares should span 120 mm" in result.output
    image = cv2.imread(str(output), cv2.IMREAD_GRAYSCALE)
    view = found_in(image, board_of("12x9:10"))
    assert len(view.ids) == 11 * 8
    width_px = np.ptp(view.pixel[:, 0])
    # ten squares from the first inner corner to the last: 100 mm as programs print it
    assert 1000.0 * width_px / physical_px_per_m(output) == pytest.approx(100.0, abs=0.02)


def test_board_for_the_lcd_fills_it_in_whole_px(tmp_path):
    output, display = tmp_path / "board.png", load_rig("simulated").display
    # 80 px of 0.063 mm
    result = calibrate(
        "board", "--board", "20x10:5.04", "--dictionary", "5X5_1000", "--rig", "simulated", "--output", output
    )
    assert result.exit_code == 0, result.output
    image = cv2.imread(str(output), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (display.rows, display.columns)
    assert "squares of 80 px" in result.output
    view = found_in(image, board_of("20x10:5.04", "5X5_1000"))
    assert len(view.ids) == 19 * 9


YAML = """image_width: 512
image_height: 384
camera_matrix: {rows: 3, cols: 3, data: [1800, 0, 262, 0, 1805, 187, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""


def test_a_file_without_sigmas_says_what_is_assumed(tmp_path, capsys):
    path = tmp_path / "camera.yaml"
    path.write_text(YAML)
    assumed = calibrate_bench._lens(path, None)
    assert capsys.readouterr().err == (
        f"! {path}: states no sigmas: 0.5 % of the focal length is assumed (--intrinsics-sigma)\n"
    )
    given = calibrate_bench._lens(path, 1.0)
    assert capsys.readouterr().err == ""
    np.testing.assert_allclose(given.intrinsics.spread, 2.0 * assumed.intrinsics.spread)
    with pytest.raises(InputError, match="only with --intrinsics"):
        calibrate_bench._lens(None, 1.0)
