"""A camera by itself: board drawn, found, and what its views give, against a planted camera."""

from dataclasses import replace

import charuco_pictures as boards
import cv2
import numpy as np
import pytest

from zeromethod.calibration import Intrinsics, Priors, fit
from zeromethod.calibration.camera_file import ASSUMED_PERCENT, load_camera, save_camera
from zeromethod.calibration.charuco import Board, NoView, View, board_of
from zeromethod.calibration.intrinsics import CameraFit, fit_camera
from zeromethod.errors import InputError, MeasurementError

TRUE = dict(zip(("fx", "fy", "cx", "cy"), (*boards.FOCAL_PX, *boards.CENTRE_PX), strict=True))
TRUE |= {"k1": boards.DISTORTION[0]}


def found_in(image: np.ndarray, board: Board = boards.BOARD, name: str = "a") -> View:
    view = board.find(name, image)
    assert isinstance(view, View)
    return view


@pytest.fixture(scope="module")
def views() -> list[View]:
    rng = np.random.default_rng(0)
    return [
        found_in(boards.seen(pose, rng), name=f"{number}.png") for number, pose in enumerate(boards.POSES_DEG)
    ]


@pytest.fixture(scope="module")
def found(views: list[View]) -> CameraFit:
    return fit_camera(views, boards.BOARD, boards.SHAPE)


def test_camera_is_found_within_its_sigma(found):
    one = found.intrinsics
    # nothing asks for more than k1, which is all that was planted
    assert tuple(one.names) == ("fx", "fy", "cx", "cy", "k1")
    away = one.values - np.array([TRUE[name] for name in one.names])
    sigma = np.sqrt(np.diag(one.covariance))
    assert np.abs(away / sigma).max() < 3.5
    # corners to 0.04 px in ten views: the focal length to a thousandth
    assert found.rms_px < 0.08
    assert sigma[0] < 1.5e-3 * boards.FOCAL_PX[0]
    # and all together: chi-squared of five, once in a thousand
    assert float(away @ np.linalg.solve(one.covariance, away)) < 20.5


def test_exact_corners_give_the_exact_camera(views, found):
    """Corners put where a known camera sees them, with noise: normalised errors over many draws."""
    rng = np.random.default_rng(1)
    away = []
    for _ in range(12):
        noisy = [replace(v, pixel=v.pixel + 0.2 * rng.standard_normal(v.pixel.shape)) for v in views]
        again = fit_camera(noisy, boards.BOARD, boards.SHAPE)
        count = len(found.intrinsics.names)
        sigma = np.sqrt(np.diag(again.intrinsics.covariance)[:count])
        away.append((again.intrinsics.values[:count] - found.intrinsics.values) / sigma)
    # 60 numbers, correlated in their fives
    assert 0.6 < np.sqrt(np.mean(np.square(away))) < 1.4


def test_a_lens_with_more_terms_gets_them():
    rng = np.random.default_rng(3)
    lens = (-0.25, 1.5, 0.002, -0.003, 0.0)
    views = [found_in(boards.seen(p, rng, distortion=lens)) for p in boards.POSES_DEG[:8]]
    one = fit_camera(views, boards.BOARD, boards.SHAPE).intrinsics
    assert {"p1", "p2"} <= set(one.names)
    values, sigma = dict(zip(one.names, one.values, strict=True)), np.sqrt(np.diag(one.covariance))
    spread = dict(zip(one.names, sigma, strict=True))
    for name, true in (("p1", 0.002), ("p2", -0.003)):
        assert abs(values[name] - true) < 3.5 * spread[name]


def test_stray_corners_do_no_harm(views, found):
    strayed = views[0].pixel.copy()
    strayed[5] += (12.0, -7.0)
    again = fit_camera([replace(views[0], pixel=strayed), *views[1:]], boards.BOARD, boards.SHAPE)
    assert again.stray == 1
    sigma = np.sqrt(np.diag(found.intrinsics.covariance))
    np.testing.assert_allclose(again.intrinsics.values, found.intrinsics.values, atol=0.5 * sigma.min() + 1.0)


def test_views_flat_on_leave_the_focal_length_open():
    rng = np.random.default_rng(2)
    views = [found_in(boards.seen((0.1 * n, 0, 30 * n), rng)) for n in range(4)]
    with pytest.raises(MeasurementError, match="tilt the board"):
        fit_camera(views, boards.BOARD, boards.SHAPE)


def test_too_few_views_and_another_board_are_refused(views):
    with pytest.raises(InputError, match="3 pictures with the board: at least 4"):
        fit_camera(views[:3], boards.BOARD, boards.SHAPE)
    wrong = Board(11, 6, 8.0, 6.0)
    kept = [replace(v, ids=v.ids, pixel=v.pixel) for v in views]
    with pytest.raises(InputError, match="another board"):
        fit_camera(kept, wrong, boards.SHAPE)


def test_pictures_without_the_board_say_why():
    rng = np.random.default_rng(4)
    image = boards.seen((30, 0, 0), rng)
    blank = np.full((200, 200), 90, np.uint8)
    assert boards.BOARD.find("a", blank) is NoView.NO_MARKERS
    assert Board(9, 7, 8.0, 6.0, "7X7_50").find("a", image) is NoView.NO_MARKERS
    assert Board(4, 3, 8.0, 6.0).find("a", image) is NoView.OTHER_BOARD
    narrow = np.where(np.arange(512) < 190, image, 255).astype(np.uint8)
    assert boards.BOARD.find("a", narrow) is NoView.FEW_CORNERS


def test_sixteen_bits_show_the_same_corners():
    rng = np.random.default_rng(5)
    image = boards.seen((20, 10, 0), rng)
    eight, twelve = found_in(image), found_in(image.astype(np.uint16) * 16)
    assert len(twelve.ids) == len(eight.ids)
    np.testing.assert_allclose(twelve.pixel, eight.pixel, atol=0.05)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("12x9", "COLUMNSxROWS"),
        ("12:10", "COLUMNSxROWS"),
        ("12x9:ten", "COLUMNSxROWS"),
        ("2x9:10", "3 to 100"),
        ("12x9:10:12", "the marker less"),
        ("12x9:-1", "above 0"),
        ("50x50:5", "need 1250 markers"),
    ],
)
def test_boards_that_cannot_be_are_refused(text, words):
    with pytest.raises(InputError, match=words) as refused:
        board_of(text)
    assert str(refused.value).startswith("--board: ")


def test_corners_of_the_drawn_board_lie_where_it_says():
    board, square_px = Board(6, 5, 10.0, 7.5), 60
    # as sharp as a lens, not as a drawing: between px a step has no place
    picture = cv2.GaussianBlur(board.picture(square_px), (0, 0), 1.0)
    view = found_in(picture, board)
    assert len(view.ids) == 5 * 4
    # half a square of margin; the edge between two px lies half a px before the second
    place = (
        board.cv.getChessboardCorners()[view.ids][:, :2] / board.square_mm * square_px + square_px / 2 - 0.5
    )
    np.testing.assert_allclose(view.pixel, place, atol=0.05)


def test_file_keeps_values_and_covariance(found, tmp_path):
    path = tmp_path / "camera.toml"
    save_camera(path, found, str(boards.BOARD))
    loaded = load_camera(path)
    assert loaded.shape == boards.SHAPE
    assert tuple(loaded.intrinsics.names) == tuple(found.intrinsics.names)
    np.testing.assert_allclose(loaded.intrinsics.values, found.intrinsics.values, rtol=1e-9)
    np.testing.assert_allclose(loaded.intrinsics.covariance, found.intrinsics.covariance, rtol=1e-8)
    with pytest.raises(InputError, match="states its sigmas"):
        load_camera(path, 1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("schema_version = 1", "schema_version = 9"), "schema_version"),
        (("values = [", "valves = ["), "not complete"),
        (('"fx"', '"fz"'), "fz"),
        (("rms_px", "rms px"), "camera.toml"),
    ],
)
def test_other_files_are_refused(change, words, found, tmp_path):
    path = tmp_path / "camera.toml"
    save_camera(path, found, "a board")
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(InputError, match=words) as refused:
        load_camera(path)
    assert "\n" not in str(refused.value)


ROS = """image_width: 512
image_height: 384
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: [1800.0, 0.0, 262.0,
         0, 1805.0, 187.0, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.25, 0, 0, 0, 0]
projection_matrix:
  rows: 3
  cols: 4
  data: [1800, 0, 262, 0, 0, 1805, 187, 0, 0, 0, 1, 0]
"""


def test_yaml_of_ros_gives_the_camera(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(ROS)
    loaded = load_camera(path)
    assert loaded.shape == boards.SHAPE
    assert loaded.states_no_sigma
    one = loaded.intrinsics
    assert dict(zip(one.names, one.values.tolist(), strict=True)) == TRUE
    corner = np.hypot(512 / 2 / 1800, 384 / 2 / 1805)
    share = ASSUMED_PERCENT / 100
    both = share * np.hypot(1, 0.1)  # together, and against each other
    expected = [1800 * both, 1805 * both, 1800 * share, 1805 * share, share / corner**2]
    np.testing.assert_allclose(one.spread, expected, rtol=1e-9)
    assert one.correlation[0, 1] == pytest.approx(1 / 1.01)
    tighter = load_camera(path, 0.1 * ASSUMED_PERCENT).intrinsics
    np.testing.assert_allclose(tighter.spread, 0.1 * one.spread)


def test_opencv_writes_what_is_read(tmp_path):
    path = tmp_path / "camera.yml"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 512), ("image_height", 384)):
        file.write(name, value)
    file.write("camera_matrix", np.array([[1800.0, 0, 262], [0, 1805, 187], [0, 0, 1]]))
    file.write("distortion_coefficients", np.array([[-0.25, 0.5, 1e-3, 0, 0]]))
    file.release()
    loaded = load_camera(path)
    assert (loaded.shape, loaded.states_no_sigma) == (boards.SHAPE, True)
    one = loaded.intrinsics
    assert tuple(one.names) == ("fx", "fy", "cx", "cy", "k1", "k2", "p1")
    np.testing.assert_allclose(one.values, [1800, 1805, 262, 187, -0.25, 0.5, 1e-3])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("plumb_bob", "equidistant"), "distortion other than"),
        (("[-0.25, 0, 0, 0, 0]", "[-0.25, 0, 0, 0, 0, 0.1, 0, 0]"), "distortion other than"),
        (("camera_matrix", "matrix"), "not complete"),
        (("image_width: 512", "image_width: 0"), "not complete"),
        (("data: [", "data: [["), "not readable as YAML"),
        (("[1800.0", "[-1800.0"), "above 0"),
        # OpenCV's reader would end the program
        (("data: [", "data: " + "[" * 100_000), "more than 1000 brackets"),
    ],
)
def test_other_yaml_is_refused(change, words, tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(ROS.replace(*change))
    with pytest.raises(InputError, match=words) as refused:
        load_camera(path)
    assert "\n" not in str(refused.value)


def test_sigmas_without_scatter_between_views_are_those_of_opencv(views):
    """The covariance is OpenCV's where the pictures agree with each other."""
    rng = np.random.default_rng(6)
    noisy = [replace(v, pixel=v.pixel + 0.3 * rng.standard_normal(v.pixel.shape)) for v in views]
    one = fit_camera(noisy, boards.BOARD, boards.SHAPE)
    pairs = [boards.BOARD.cv.matchImagePoints(v.pixel.astype(np.float32), v.ids) for v in noisy]
    points, pixels = zip(*pairs, strict=True)
    flags = cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
    size = boards.SHAPE[::-1]
    found = cv2.calibrateCameraExtended(points, pixels, size, np.eye(3), np.zeros(5), flags=flags)
    sigma = found[5].ravel()[:5]
    np.testing.assert_allclose(one.intrinsics.values[:4], found[1][[0, 1, 0, 1], [0, 1, 2, 2]], rtol=1e-6)
    # raised, never lowered, by one factor for all
    factor = one.intrinsics.spread / sigma
    assert factor.min() > 0.99
    np.testing.assert_allclose(factor, factor.mean(), rtol=1e-3)


def test_fit_takes_the_camera_as_it_is_known(positions, rest_fit):
    camera = rest_fit.rig.camera
    true = np.array([1.004 * camera.focal_px[0], 1.004 * camera.focal_px[1]])
    lens = Intrinsics(("fx", "fy"), true, np.diag((5e-4 * true) ** 2))
    known = fit(Priors.of(rest_fit.priors.rig), [positions, lens])
    assert (
        known.sigma["camera.scale"] < 0.1 * rest_fit.priors.sigma[rest_fit.priors.names.index("camera.scale")]
    )
    assert known.rig.camera.focal_px[0] == pytest.approx(true[0], rel=1.5e-3)
