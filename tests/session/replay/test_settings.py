"""Other settings for a rig at hand."""

import pytest

from zeromethod import InputError, load_rig
from zeromethod.session.replay.settings import with_settings


def test_settings_are_those_of_a_rig_file():
    rig = load_rig("simulated")
    changed = with_settings(
        rig,
        [
            "control.gain=0.5",
            "control.controller=integrator",
            'target.kind = "checker"',
            "surface.known_rest=[{x_mm=[1.0, 2.0], y_mm=[0.0, 1.0]}]",
            "pattern_layers[0].thickness_mm=2.5",
        ],
    )
    assert (changed.control.gain, changed.control.controller) == (0.5, "integrator")
    assert changed.target.kind == "checker"
    assert changed.surface.known_rest[0].x_mm == (1.0, 2.0)
    assert changed.pattern_layers[0].thickness_mm == 2.5
    assert changed.prism == rig.prism
    assert rig.control.gain == 1.0


def test_later_settings_win_and_none_leaves_the_rig_as_it_is():
    rig = load_rig("paper")
    assert with_settings(rig, ["control.gain=0.5", "control.gain=0.25"]).control.gain == 0.25
    assert with_settings(rig, []) is rig
    assert with_settings(rig, [f"name={rig.name}"]) == rig


@pytest.mark.parametrize(
    ("setting", "word"),
    [
        ("gain", "key=value"),
        ("=3", "key=value"),
        ("control.gian=1", "did you mean gain"),
        ("control.gain=2", "at most 1"),
        ("control.gain=much", "a number"),
        ("pattern_layers[9].index=1.5", "a dotted key of a rig file"),
        ("name.first=1", "a dotted key of a rig file"),
    ],
)
def test_what_is_no_setting_is_refused_in_one_line(setting, word):
    with pytest.raises(InputError, match=word) as caught:
        with_settings(load_rig("simulated"), [setting])
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("--set: ")
