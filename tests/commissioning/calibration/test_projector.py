"""Where a projector's picture falls, found by its own fringes through the cloth, and kept in the rig file."""

import numpy as np
import pytest

from benchmarks.rigs import coarser
from zeromethod import load_rig
from zeromethod.commissioning.calibration import recall, store_calibration
from zeromethod.commissioning.calibration.calibrate import calibrate
from zeromethod.commissioning.calibration.projector import projector_values, see_projection
from zeromethod.commissioning.patterns import TimedPatterns
from zeromethod.devices.opening import open_devices
from zeromethod.errors import MeasurementError
from zeromethod.interactive.homography import mapped, mm_to_px
from zeromethod.simulation.projected import true_map

OFF_MM = [[0.6, -0.4], [-0.5, 0.3], [0.2, 0.7], [-0.8, -0.6]]
"""By how much the corners are not where the rig file says."""


@pytest.fixture(scope="module")
def rig():
    bench = coarser(load_rig("interactive"), 4)
    return bench.replace({"cloth.weave_mm": 0.6, "scenario": "none", "simulation.projector_off_mm": OFF_MM})


def test_a_calibration_finds_the_projectors_map_and_keeps_it_in_the_rig_file(rig, tmp_path):
    found = calibrate(rig, light=False, delay=False, edges=False, rest_frames=2)
    seen = found.recorded.projection
    spec = found.rig.projector
    places = mapped(np.linalg.inv(true_map(rig)), seen.picture_px)
    off = mapped(np.linalg.inv(mm_to_px(spec)), seen.picture_px) - places
    # the LCD's place is known to 0.25 mm, and so is the mirror's by the fit; see below for the map alone
    assert np.sqrt(np.mean(off**2)) < 0.25
    before = mapped(np.linalg.inv(mm_to_px(rig.projector)), seen.picture_px) - places
    assert np.sqrt(np.mean(before**2)) > 0.3
    stored = store_calibration(found, "interactive", home=tmp_path)
    assert load_rig(stored.rig_file).projector.corners_mm == spec.corners_mm
    assert stored.document["projector"]["sigma_mm"] == spec.sigma_mm
    recorded, _ = recall(stored.folder)
    np.testing.assert_array_equal(recorded.projection, seen)  # so that it can be evaluated again


def _seen(rig, projector=None):
    with open_devices(rig) as devices:
        patterns = TimedPatterns(rig, devices, 0.05)
        shown = [projector or devices.display.projector]
        return see_projection(rig, patterns, shown, 2, devices.clock.now_ns, lambda: None)


def test_the_maps_sigma_holds_on_a_bench_whose_geometry_is_known(rig):
    seen = _seen(rig)
    spec = rig.replace(projector_values(rig, seen)).projector
    places = mapped(np.linalg.inv(true_map(rig)), seen.picture_px)
    off = mapped(np.linalg.inv(mm_to_px(spec)), seen.picture_px) - places
    # sigma is what is left at single blocks, of which each is worse than the map through all
    assert np.sqrt(np.mean(off**2)) < spec.sigma_mm < 0.15


class Dark:
    """A projector that shows nothing."""

    trouble = ""

    def show(self, picture):
        """Nothing."""

    def poll(self):
        """Nothing."""


def test_a_projector_that_is_off_is_said_so(rig):
    with pytest.raises(MeasurementError, match="projector: its fringes are not seen"):
        _seen(rig, Dark())
