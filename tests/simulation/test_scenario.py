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
def test_every_packaged_scenario_loads_and_its_phases_lie_in_it(path: Path) -> None:
    scenario = load_scenario(path.stem)
    assert scenario.name == path.stem
    assert all(phase.to_s <= scenario.duration_s for phase in scenario.phases)
    assert scenario.mirror_at(0).dents == ()


def test_default_comes_down_holds_slides_and_lifts() -> None:
    scenario = load_scenario("default")
    assert scenario.mirror_at(ns(0.3)).dents == ()
    (half_down,) = scenario.mirror_at(ns(0.425)).dents
    assert (half_down.shape, half_down.size_mm) == (Shape.GAUSSIAN, 5.0)
    assert half_down.depth_mm == pytest.approx(0.1)
    (sliding,) = scenario.mirror_at(ns(1.5)).dents
    assert (sliding.x_mm, sliding.depth_mm) == pytest.approx((42.0, 0.2))
    (later,) = scenario.mirror_at(ns(1.6)).dents
    assert later.x_mm - sliding.x_mm == pytest.approx(1.0)  # 10 mm/s along +x
    assert scenario.mirror_at(ns(2.5)).dents == ()
    names = [scenario.phase_at(ns(t)) for t in (0.1, 0.4, 0.7, 1.5, 2.1, 2.3, 2.5, 9.0)]
    assert names == ["untouched", "press", "hold", "slide", "settle", "lift", "rest", None]


def test_moving_tells_motion_from_rest_hold_and_jumps() -> None:
    default, step = load_scenario("default"), load_scenario("step")
    assert not default.moving(ns(0.0), ns(0.35))
    assert default.moving(ns(0.34), ns(0.36))
    assert not default.moving(ns(0.5), ns(1.0))
    assert default.moving(ns(1.2), ns(1.21))
    assert not step.moving(ns(0.0), ns(1.0))
    assert step.bends_ns(0, ns(1.0)) == (ns(0.2),)
    assert step.bends_ns(ns(0.2), ns(1.0)) == ()  # at its border an exposure needs no cut


def test_a_jump_is_complete_at_its_own_time() -> None:
    step = load_scenario("step")
    assert step.mirror_at(ns(0.2) - 1).dents == ()
    assert step.mirror_at(ns(0.2)).dents[0].depth_mm == 0.2


def test_a_held_mirror_is_the_same_mirror() -> None:
    default = load_scenario("default")
    assert default.mirror_at(ns(0.6)) == default.mirror_at(ns(0.9))


def test_a_touching_ball_covers_its_hertz_contact_at_every_depth() -> None:
    ball = load_scenario("ball")
    for time_s in (0.375, 0.8):
        (dent,) = ball.mirror_at(ns(time_s)).dents
        assert dent.contact_mm == pytest.approx(np.sqrt(150.0 * dent.depth_mm))


def test_map_file_lies_beside_the_press_file(tmp_path: Path) -> None:
    np.save(tmp_path / "h.npy", np.ones((4, 6)))
    text = """
    [[press]]
    shape = "map"
    file = "h.npy"
    pitch_mm = 0.5
    path = [{ time_s = 0.0, x_mm = 1.0, y_mm = 2.0, depth_mm = 0.3 }]
    """
    scenario = load_scenario(written(tmp_path, text))
    assert float(scenario.mirror_at(0).depth(1.25, 2.25)) == pytest.approx(0.3)
    assert scenario.mirror_at(0) == scenario.mirror_at(5)


POINT = "path = [{ time_s = 0.0, x_mm = 1.0, y_mm = 2.0, depth_mm = 0.3 }]"


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("[[press]]\nshape = 'gaussian'\n" + POINT, "sigma_mm"),
        ("[[press]]\nshape = 'gaussian'\nsigma_mm = -1\n" + POINT, "greater than 0"),
        ("[[press]]\nshape = 'pyramid'\n" + POINT, "gaussian"),
        ("[[press]]\nshape = 'gaussian'\nsigma_mm = 1\nradius = 2\n" + POINT, "radius"),
        ("[[press]]\nshape = 'gaussian'\nsigma_mm = nan\n" + POINT, "finite"),
        ("[[press]]\nshape = 'ball'\nradius_mm = 3\npath = []", "path"),
        (
            "[[press]]\nshape = 'ball'\nradius_mm = 3\npath = [{time_s=1,x_mm=0,y_mm=0,depth_mm=0},"
            "{time_s=0,x_mm=0,y_mm=0,depth_mm=0}]",
            "time_s must not fall",
        ),
        ("[[press]]\nshape = 'map'\nfile = 'no.npy'\npitch_mm = 1\n" + POINT, "no.npy"),
        ("[[phase]]\nname = 'hold'\nfrom_s = 2\nto_s = 1", "to_s must be greater"),
        ("duration_s = 'long'", "duration_s"),
        ("press = [", "not TOML"),
    ],
)
def test_bad_press_files_are_refused_in_one_line(tmp_path: Path, text: str, word: str) -> None:
    with pytest.raises(InputError) as caught:
        load_scenario(written(tmp_path, text))
    message = str(caught.value)
    assert word in message
    assert "mine.toml" in message or "no.npy" in message
    assert "\n" not in message


def test_maps_that_are_no_maps_are_refused(tmp_path: Path) -> None:
    text = "[[press]]\nshape = 'map'\nfile = 'h.npy'\npitch_mm = 1\n" + POINT
    for bad in (np.ones(5), np.full((4, 4), np.nan), np.array([["a", "b"]])):
        np.save(tmp_path / "h.npy", bad)
        with pytest.raises(InputError, match=r"h\.npy"):
            load_scenario(written(tmp_path, text))


def test_unknown_name_lists_the_packaged_ones() -> None:
    with pytest.raises(InputError, match=r"nope.*default.*step"):
        load_scenario("nope")
