"""`zeromethod init` as a person meets it: options, questions, refusals."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import Result
from commands import assert_refused, typed

from zeromethod import Optics, load_rig
from zeromethod.calibration import PARAMETERS, Priors, describe
from zeromethod.cli.init import init_command
from zeromethod.rig.tables import FaceSupports, Rubber


def init(*arguments: object, answers: str | None = None) -> Result:
    return typed(init_command, *arguments, answers=answers)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "my.toml"


def test_without_options_it_is_the_packaged_bench_to_caliper_grade(path):
    assert init(path).exit_code == 0
    made, packaged = describe(load_rig(path)), describe(load_rig("simulated"))
    for name, value in packaged.items():
        # a tenth of what calipers leave open, or rounding where a value is taken as exact
        assert made[name] == pytest.approx(
            value, abs=max(0.1 * PARAMETERS[name].sigma(load_rig(path)), 1e-9)
        ), name


def test_starts_from_another_rig(path):
    assert init(path, "--from", "virtual").exit_code == 0
    found, given = load_rig(path).display, load_rig("virtual").display
    assert found.columns == given.columns
    # a grabbed monitor changes all at once, which calibrate could not find out there
    assert (found.scanout_s, found.rise_s) == (given.scanout_s, given.rise_s) == (0.0, 0.0)


def test_options_end_up_in_the_file(path):
    options: dict[str, Any] = {
        "--pattern-angle": 52.5,
        "--leg": 55.0,
        "--index": 1.43,
        "--gap": 0.8,
        "--lcd-columns": 1280,
        "--pitch": 0.09,
        "--camera-rows": 960,
        "--rate": 30.0,
        "--exposure": 0.02,
    }
    assert init(path, *(part for pair in options.items() for part in pair)).exit_code == 0
    rig = load_rig(path)
    prism, display, camera = rig.prism, rig.display, rig.camera
    gap_mm = rig.pattern_layers[-1].thickness_mm
    found = [prism.pattern_angle_deg, prism.pattern_length_mm, prism.index, gap_mm]
    found += [display.columns, display.pitch_mm, camera.rows, camera.rate_hz, camera.exposure_s]
    assert found == list(options.values())
    assert rig.name == "my"


def test_camera_sees_the_lcd_by_the_mirror_whatever_the_prism(path):
    options = ("--pattern-angle", 47, "--camera-angle", 55, "--leg", 50, "--lcd-along", 25)
    assert init(path, *options).exit_code == 0
    rig = load_rig(path)
    u, v = np.meshgrid(np.linspace(0, 1279, 5), np.linspace(0, 1023, 5))
    q = Optics(rig).rest_map(u, v)[1:-1, 1:-1]
    assert np.isfinite(q).all()
    assert (q > 0).all()
    assert (q < (1920, 1080)).all()


def test_camera_stands_on_the_camera_face_s_normal(path):
    init(path, "--camera-angle", 55, "--distance", 200)
    camera = load_rig(path).camera
    along, _, down = np.subtract(camera.look_at_mm, camera.position_mm)
    assert math.degrees(math.atan2(down, -along)) == pytest.approx(90 - 55, abs=1e-3)


def test_focal_length_counts_how_near_the_lens_is_focused(path):
    init(path, "--lens", 50, "--pixel", 5, "--distance", 300)
    rig = load_rig(path)
    focus = 300 + 60 / 1.41
    # thin lens: 1/f = 1/focus + 1/image
    assert rig.camera.focal_px[0] == pytest.approx(1e3 / 5 / (1 / 50 - 1 / focus), rel=1e-4)


def test_file_says_what_its_values_are(path):
    init(path)
    text = path.read_text()
    for words in (
        "zeromethod calibrate --rig my.toml",
        "angle_deg = 0.3 ",
        "origin on the edge P0",
        "found by calibrate",
    ):
        assert words in text


def test_answers_take_the_place_of_what_was_not_given(path):
    result = init(path, "--ask", "--leg", 58, answers="51.5\n" + "\n" * 30)
    assert result.exit_code == 0
    prism = load_rig(path).prism
    assert (prism.pattern_angle_deg, prism.camera_angle_deg, prism.pattern_length_mm) == (51.5, 50.0, 58.0)
    assert "length of the pattern face" not in result.output


def test_sigmas_and_aim_are_asked_with_the_values_and_used(path):
    options = ("--angle-sigma", 0.05, "--leg-sigma", 0.5, "--lens-sigma", 3, "--aim-x", 50, "--aim-y", -2)
    assert init(path, *options).exit_code == 0
    rig = load_rig(path)
    assert rig.camera.look_at_mm == (50.0, -2.0, 0.0)
    # on the camera face's normal: the face is not tilted about x
    assert rig.camera.position_mm[1] == -2.0
    sigma = dict(zip(Priors.of(rig).names, Priors.of(rig).sigma, strict=True))
    assert sigma["prism.pattern_angle_deg"] == 0.05
    assert sigma["prism.length_mm"] == 0.5
    assert sigma["camera.scale"] == pytest.approx(0.03)
    # of what was not said, those of calipers
    assert sigma["display.along_mm"] == 1.2


def test_enter_keeps_the_sigmas_and_an_aim_that_fits_the_prism(path):
    result = init(path, "--ask", "--leg", 58, answers="\n" * 40)
    assert result.exit_code == 0
    rig = load_rig(path)
    assert rig.priors == load_rig("simulated").priors
    assert "the pattern face's length: standard deviation, mm [0.05]" in result.output
    mirror_mm = 2 * 58 * math.cos(math.radians(50))
    assert rig.camera.look_at_mm[0] == pytest.approx(0.545 * mirror_mm, abs=0.05)


def test_what_holds_the_rubber_is_not_known_unless_it_is_said(path):
    assert init(path, "--from", "simulated").exit_code == 0
    assert load_rig(path).rubber.not_known
    assert "[rubber]" in path.read_text()
    assert 'support = "free"' in path.read_text()  # how to say it
    again = path.with_name("again.toml")
    assert init(path, "--force", "--support", "sliding", "--thickness", 7).exit_code == 0
    assert init(again, "--from", path).exit_code == 0
    assert load_rig(again).rubber == load_rig(path).rubber
    assert init(again, "--from", path, "--support", "unknown", "--force").exit_code == 0
    assert load_rig(again).rubber.support is None


def test_stiffness_stays_where_only_what_holds_the_rubber_is_said(path):
    init(path)
    path.write_text(path.read_text().replace("[rubber]", "[rubber]\nyoungs_modulus_mpa = 0.7"))
    again = path.with_name("again.toml")
    assert init(again, "--from", path, "--support", "free").exit_code == 0
    assert load_rig(again).rubber == Rubber(youngs_modulus_mpa=0.7, support="free")


@pytest.mark.parametrize(
    ("answers", "options", "rubber"),
    [
        ("free", ("--support", "free"), {"support": "free"}),
        (
            "bonded\n\n7\n0.1",  # Enter is no thickness
            ("--support", "bonded", "--thickness", 7, "--thickness-sigma", 0.1),
            {"support": "bonded", "thickness_mm": 7.0, "thickness_sigma_mm": 0.1},
        ),
        # of a thickness that no deviation is given with: that of the calipers
        (
            "sliding\n7\n",
            ("--support", "sliding", "--thickness", 7),
            {"support": "sliding", "thickness_mm": 7.0, "thickness_sigma_mm": 0.05},
        ),
        (
            "faces\n\nsliding\n",
            ("--support", "faces", "--camera-support", "sliding"),
            {"support": FaceSupports(pattern="bonded", camera="sliding", ends="free")},
        ),
        ("unknown", ("--support", "unknown"), {}),
        ("glue\n", (), {}),  # is refused at once, and asked for again
    ],
)
def test_what_holds_the_rubber_is_asked_and_can_be_given(path, answers, options, rubber):
    asked = init(path, "--ask", answers=9 * "\n" + answers + 30 * "\n")
    assert asked.exit_code == 0, asked.output
    assert ("thickness of the layer" in asked.output) == ("thickness_mm" in rubber)
    assert ("the camera face is held" in asked.output) == isinstance(rubber.get("support"), FaceSupports)
    assert load_rig(path).rubber == Rubber(**rubber)
    assert init(path, "--force", *options).exit_code == 0
    assert load_rig(path).rubber == Rubber(**rubber)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--thickness", 7), "--thickness: 7.0: only with --support bonded or sliding"),
        (("--support", "free", "--thickness", 7), "--thickness: 7.0: only with --support bonded or sliding"),
        (("--support", "bonded"), "--thickness: missing: a number above 0 with --support bonded"),
        (("--ends-support", "free"), "--ends-support: free: only with --support faces"),
        (
            ("--support", "faces", "--pattern-support", "free", "--camera-support", "free"),
            "one face 'bonded', or pattern and camera 'sliding': else nothing holds the prism",
        ),
    ],
)
def test_what_cannot_hold_rubber_is_refused(path, options, said):
    assert_refused(init(path, *options), said)
    assert not path.exists()


def test_nothing_is_overwritten_unless_forced(path):
    path.write_text("mine")
    result = init(path)
    assert_refused(result, "--force")
    assert path.read_text() == "mine"
    assert init(path, "--force").exit_code == 0
    assert load_rig(path).name == "my"


def test_input_that_ends_early_writes_nothing_and_says_so(path):
    result = init(path, "--ask", answers="50\n0.3\n50\n0.18\n")
    assert_refused(result, "the input ended at 'length of the pattern face")
    assert not path.exists()


def test_answers_out_of_range_or_that_make_no_bench_are_asked_for_again(path):
    # the last answer of the first round is an exposure longer than a frame
    result = init(path, "--ask", answers="-5\n51.5\n" + "\n" * 28 + "1\n" + "\n" * 29 + "0.01\n")
    assert result.exit_code == 0, result.output
    assert "camera.exposure_s: 1.0: at most the frame time" in result.output
    rig = load_rig(path)
    assert (rig.prism.pattern_angle_deg, rig.camera.exposure_s) == (51.5, 0.01)


def test_a_name_with_blanks_is_quoted_in_what_to_type_next(tmp_path):
    path = tmp_path / "my bench.toml"
    assert f"zeromethod design '{path}'" in init(path).output
    assert "zeromethod run --rig 'my bench.toml'" in path.read_text()


@pytest.mark.parametrize(
    "arguments",
    [
        ("--gap", 999, "--lcd-along", 3000),
        ("--pitch", 90),
        ("--distance", 28, "--from", "virtual"),
        ("--width", 0.01),
        ("--pixel", 1e-300),
        ("--lens", "nan"),
    ],
)
def test_a_bench_that_cannot_be_is_not_written(arguments, path):
    assert init(path, *arguments).exit_code != 0
    assert not path.exists()
