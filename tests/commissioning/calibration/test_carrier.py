"""The carrier's advice by what was measured: blur from the fringes, light from the settling, kept on disk."""

import pytest

from zeromethod.commissioning.calibration.carrier import advised_carrier
from zeromethod.design.carrier import carrier_words

from .planted import nominal


def test_blur_is_the_fringes_not_the_rig_files(calibration):
    recorded, rig = calibration.recorded, calibration.fitted.rig
    wrong = rig.model_copy(update={"camera": rig.camera.model_copy(update={"psf_px": 2.0})})
    found = advised_carrier(wrong, calibration.rest, recorded.rest, recorded.settling)
    assert found["blur_measured"]
    # fringes of 14 to 18 camera px lose 6 to 4 % of contrast by it; light is known to a thousandth of theirs
    assert found["blur_px"] == pytest.approx(nominal().camera.psf_px, abs=0.05)


def test_advice_is_kept_with_its_curve(calibration):
    found = calibration.carrier
    assert (found["present_px"], found["curve"][0]["period_px"]) == (8, 8)
    assert found["words"] == carrier_words(found)
    # 9 LCD px of the true bench's coarse LCD, at the finest period that there is
    assert (found["advised_px"], found["words"]) == (8, "")
