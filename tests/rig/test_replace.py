"""Edits of a rig are checked as rig files are, and a rig says what it is in one line."""

from pathlib import Path

import numpy as np
import pytest

from zeromethod import InputError, load_rig
from zeromethod.rig.model import CameraSpec, ControlSpec, Layer, Prism, Rig

RIG = load_rig("simulated")


def test_dotted_keys_change_their_value_and_no_other():
    changed = RIG.replace(
        {
            "display.pitch_mm": 0.06,
            "pattern_layers[0].index": np.float64(1.5),
            "camera.focal_px[1]": 9001.0,
            "camera.position_mm": np.array([277.0, 0.0, -197.0]),
            "simulation.faults.drop_frames": (3,),
        },
        scenario="step",
    )
    assert changed.display.pitch_mm == 0.06
    assert changed.pattern_layers[0].index == 1.5
    assert changed.camera.focal_px == (9000.0, 9001.0)
    assert changed.camera.position_mm == (277.0, 0.0, -197.0)
    assert changed.simulation.faults.drop_frames == (3,)
    assert changed.scenario == "step"
    assert load_rig("simulated") == RIG
    assert RIG.replace() == RIG
    back = {"display.pitch_mm": 0.063, "pattern_layers[0].index": 1.0, "camera": RIG.camera}
    assert changed.replace(back | {"simulation": RIG.simulation, "scenario": "default"}) == RIG


def test_dotted_keys_may_be_keywords_and_tables_be_given_whole():
    assert RIG.replace(**{"display.pitch_mm": 0.06}) == RIG.replace({"display.pitch_mm": 0.06})
    control = ControlSpec(gain=0.5)
    assert RIG.replace(control=control).control == control
    assert RIG.replace(control={"gain": 0.5}).control == control
    assert (
        RIG.replace({"pattern_layers": [Layer(index=1.5, thickness_mm=1.0)]}).pattern_layers[0].index == 1.5
    )


def test_none_takes_a_key_out():
    by_mirror = RIG.replace({"prism.pattern_length_mm": None, "prism.mirror_length_mm": 77.0})
    assert by_mirror.prism.pattern_length_mm is None
    assert RIG.replace({"display.gamma": None}).display.gamma == 1.0
    assert RIG.replace({"camera.rest_map": None}) == RIG


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"press": "step"}, "press: unknown key: did you mean scenario?"),
        ({"camera.focal_px[7]": 1.0}, "camera.focal_px[7]: 1.0: a dotted key of a rig file"),
        ({"name.first": "a"}, 'name.first: "a": a dotted key of a rig file'),
        ({"": 1}, ": 1: a dotted key of a rig file"),
        ({"camera.rest_map": Path("no.npz")}, 'camera.rest_map: "no.npz": an existing .npz or .h5 file'),
    ],
)
def test_keys_that_lead_nowhere_are_refused(values, message):
    with pytest.raises(InputError) as caught:
        RIG.replace(values)
    assert str(caught.value).startswith(f"rig: {message}")
    assert "\n" not in str(caught.value)


def test_tables_made_by_hand_are_refused_in_the_same_words():
    with pytest.raises(InputError, match=r"^Layer: index: 0\.9: a number at least 1 and at most 4$"):
        Layer(index=0.9, thickness_mm=1.0)
    with pytest.raises(InputError, match=r"^ControlSpec: gian: unknown key: did you mean gain\?$"):
        ControlSpec(gian=0.5)  # type: ignore[call-arg]
    with pytest.raises(InputError, match=r"^Rig: camera\.columns: 3: a whole number at least 64"):
        Rig(**RIG.model_dump() | {"camera": {"columns": 3}})
    with pytest.raises(InputError, match=r"^Rig\.press: unknown key"):
        RIG.model_copy(update={"press": "none"})


def test_a_rig_and_its_tables_say_what_they_are():
    assert repr(RIG) == "Rig('simulated', camera 1280x1024 @ 60 Hz, LCD 1920x1080, prism 50/50 deg)"
    assert str(RIG) == repr(RIG)
    assert repr(RIG.camera) == "CameraSpec('simulated', 1280x1024 px @ 60 Hz, 8 bits, perspective)"
    assert repr(RIG.display) == "DisplaySpec('simulated', 1920x1080 px @ 60 Hz, pitch 0.063 mm)"
    assert repr(RIG.prism) == "Prism(50/50 deg, index 1.41, 60 mm wide)"
    assert isinstance(RIG.camera, CameraSpec)
    assert isinstance(RIG.prism, Prism)
