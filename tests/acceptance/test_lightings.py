"""A ball that touches is named under other lights, and nothing before it does."""

import pytest

from benchmarks.lightings import rig_of, touching


@pytest.mark.parametrize("light", [{"room": 1.0, "mains": 0.5}, {"ring": 0.3}], ids=["room, mains", "ring"])
def test_a_ball_is_named_when_it_touches_and_nothing_before(light):
    rig = rig_of("lit room", light, 4)
    assert touching(rig, rig.camera.exposure_s) == (True, 0)
