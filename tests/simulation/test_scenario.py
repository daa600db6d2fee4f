"""Press files and the kinematics of their paths."""

from pathlib import Path

import numpy as np
import pytest

from zeromethod.errors import InputError
from zeromethod.resources import resource
from zeromethod.simulation.press import Shape
from zeromethod.simulation.scenario import load_scenario


def ns(time_s: float) -> int:
    return round(time_s * 1e9)


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    "path", sorted(resource("calibration", "presses").glob("*.toml")), ids=lambda p: p.stem
)
def test_every_packaged_scenario_loads_and_its_phases_lie_in_it(path):
    scenario = load_scenario(path.stem)
    assert scenario.name == path.stem
    assert all(phase.to_s <= scenario.duration_s for phase in scenario.phases)
    assert scenario.mirror_at(0).dents == ()


def test_default_comes_down_holds_slides_and_lifts():
    scenario = load_scenario("default")
    assert scenario.mirror_at(ns(0.3)).dents == ()
    (half_down,) = scenario.mirror_at(ns(0.425)).dents
    assert (half_down.shape, half_down.size_mm) == (Shape.RADIAL, pytest.approx(5.0, abs=0.01))
    assert half_down.depth_mm == pytest.approx(0.1)
    (sliding,) = scenario.mirror_at(ns(1.5)).dents
    assert (sliding.x_mm, sliding.depth_mm) == pytest.approx((42.0, 0.2))
    (later,) = scenario.mirror_at(ns(1.6)).dents
    assert later.x_mm - sliding.x_mm == pytest.approx(1.0)  # 10 mm/s along +x
    assert scenario.mirror_at(ns(2.5)).dents == ()
    names = [scenario.phase_at(ns(t)) for t in (0.1, 0.4, 0.7, 1.5, 2.1, 2.3, 2.5, 9.0)]
    assert names == ["untouched", "press", "hold", "slide", "settle", "lift", "rest", None]


def test_motion_is_neither_rest_nor_hold_nor_a_jump():
    default, step = load_scenario("default"), load_scenario("step")
    assert not default.moving(ns(0.0), ns(0.35))
    assert default.moving(ns(0.34), ns(0.36))
    assert not default.moving(ns(0.5), ns(1.0))
    assert default.moving(ns(1.2), ns(1.21))
    assert not step.moving(ns(0.0), ns(1.0))
    assert step.bends_ns(0, ns(1.0)) == (ns(0.2),)
    assert step.bends_ns(ns(0.2), ns(1.0)) == ()  # at its border an exposure needs no cut


def test_a_jump_is_complete_at_its_own_time():
    step = load_scenario("step")
    assert step.mirror_at(ns(0.2) - 1).dents == ()
    assert step.mirror_at(ns(0.2)).dents[0].depth_mm == 0.2


def test_a_mirror_that_stands_still_is_the_same_mirror():
    default = load_scenario("default")
    assert default.mirror_at(ns(0.6)) == default.mirror_at(ns(0.9))


def test_a_touching_ball_covers_its_hertz_contact_at_every_depth():
    ball = load_scenario("ball")
    for time_s in (0.375, 0.8):
        (dent,) = ball.mirror_at(ns(time_s)).dents
        assert dent.contact_mm == pytest.approx(np.sqrt(150.0 * dent.depth_mm))


def test_map_file_lies_next_to_the_press_file(tmp_path):
    np.save(tmp_path / "h.npy", np.ones((4, 6)))
    scenario = load_scenario(written(tmp_path, MAP.replace("pitch_mm = 1", "pitch_mm = 0.5")))
    assert float(scenario.mirror_at(0).depth(1.25, 2.25)) == pytest.approx(0.3)
    assert scenario.mirror_at(0) == scenario.mirror_at(5)


POINT = "path = [{ time_s = 0.0, x_mm = 1.0, y_mm = 2.0, depth_mm = 0.3 }]\n"
PAD = f"[[press]]\nshape = 'gaussian'\n{POINT}"
MAP = f"[[press]]\nshape = 'map'\nfile = 'h.npy'\npitch_mm = 1\n{POINT}"
BACK = "[[press]]\nshape = 'ball'\nradius_mm = 3\npath = [{time_s=1,x_mm=0,y_mm=0,depth_mm=0},"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PAD, "press[0].sigma_mm: missing: needed for shape 'gaussian'"),
        (PAD + "sigma_mm = -1", "press[0].sigma_mm: -1: a number above 0"),
        (PAD + "sigma_mm = nan", "press[0].sigma_mm: nan: a number above 0"),
        (PAD + "sigma_mm = 1\nradius = 2", "press[0].radius: unknown key: did you mean radius_mm?"),
        (PAD + "sigma_mm = 1\nradius_mm = 2", "press[0].radius_mm: 2.0: not for shape 'gaussian'"),
        (
            PAD.replace("gaussian", "pyramid"),
            'press[0].shape: "pyramid": one of "load", "ring", "rod", "rough", ',
        ),
        ("[[press]]\nshape = 'ball'\npath = []", "press[0].path: []: a list that is not empty"),
        (BACK + "{time_s=0,x_mm=0,y_mm=0,depth_mm=0}]", "press[0].path: [1.0, 0.0]: time_s must not fall"),
        ("[[phase]]\nname = 'hold'\nfrom_s = 2\nto_s = 1", "phase[0].to_s: 1.0: above from_s"),
        ("duration_s = 'long'", 'duration_s: "long": a number above 0'),
        ("press = [", "Invalid value (at end of document): not TOML"),
        (MAP, "press[0].file: "),
    ],
)
def test_bad_press_files_are_refused_in_one_line(tmp_path, text, message):
    file = written(tmp_path, text)
    with pytest.raises(InputError) as caught:
        load_scenario(file)
    assert str(caught.value).startswith(f"{file}: {message}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("bad", [np.ones(5), np.full((4, 4), np.nan), np.array([["a", "b"]])], ids=str)
def test_maps_that_are_no_maps_are_refused(tmp_path, bad):
    np.save(tmp_path / "h.npy", bad)
    with pytest.raises(InputError, match=r"h\.npy"):
        load_scenario(written(tmp_path, MAP))
