import numpy as np
import pytest

from benchmarks.calibration_study import Truth
from zeromethod import InputError, load_rig
from zeromethod.calibration import PARAMETERS, Priors, RestPositions, ToothSeams, build, fit
from zeromethod.calibration.rays import teeth_seen, tooth_phase
from zeromethod.optics import Optics
from zeromethod.optics.saw_rays import seams
from zeromethod.rig.binning import binned
from zeromethod.simulation.press import Mirror

UNEVEN = [0.0, 0.02, -0.03, 0.05, 0.0, 0.04, -0.02, 0.01, 0.0, 0.0]


def test_a_tips_image_is_where_rays_change_teeth():
    rig = load_rig("thin").replace({"prism.teeth.base_deviation_mm": UNEVEN})
    u, v = np.arange(1024.0), np.full(1024, 300.0)
    _, entry, _ = seams(Optics(rig), u, v)
    changes = np.flatnonzero(np.diff(entry)) + 0.5
    assert len(changes) == 4
    # the change lies within the pixel before it, half a pixel either way
    assert np.abs(tooth_phase(rig, changes, np.full(4, 300.0))[0]).max() < 0.6


def test_a_saw_off_by_caliper_values_is_found_by_its_rest_map():
    given = binned(load_rig("thin"), 2)
    priors = Priors.of(given)
    rng = np.random.default_rng(3)
    bench = Truth(priors.at(priors.within(rng.standard_normal(len(priors.names)))), rng)
    rest = bench.warp(Mirror())
    marks = ToothSeams.of(given, bench.grid, rest)
    assert marks is not None
    # three bands of a view that is four teeth wide; within three sigma of where they truly are
    assert len(marks.pixel) == 12
    assert np.abs(marks.predict(bench.rig)).max() < 3.0 * marks.sigma_px
    fitted = fit(priors, [RestPositions.of(bench.grid, rest), marks])
    assert fitted.settled
    assert fitted.inflation == 1.0
    # chi-squared of 1,400 numbers: 4 %, and some for marks
    assert fitted.chi2_per_freedom == pytest.approx(1.0, abs=0.15)
    # teeth in the middle of the view are known better than by protractor, and each by itself
    seen = [f"tooth{k}.pattern_deg" for k in (3, 4)]
    assert max(fitted.sigma[name] for name in seen) < 0.7 * given.priors.tooth_angle_deg
    off = [
        (fitted.values[name] - bench.rig.prism.teeth.pattern_deviation_deg[k])
        for k, name in zip((3, 4), seen, strict=True)
    ]
    assert np.abs(off).max() < 3.0 * max(fitted.sigma[name] for name in seen)


def test_a_tooth_measured_by_itself_has_its_own_sigma():
    sigmas = [0.02] * 9 + [0.005]
    rig = load_rig("thin").replace({"prism.teeth.base_sigma_mm": sigmas})
    assert PARAMETERS["tooth9.base_mm"].sigma(rig) == 0.005
    assert PARAMETERS["tooth9.camera_deg"].sigma(rig) == rig.priors.tooth_angle_deg
    moved = build(rig, {"tooth9.base_mm": 0.01}).prism.teeth
    assert moved is not None
    assert moved.base_deviation_mm[9] == 0.01


@pytest.mark.parametrize("sigmas", [[0.02] * 9, [-0.01] * 10])
def test_sigmas_that_are_not_one_a_tooth_are_refused(sigmas):
    with pytest.raises(InputError, match="base_sigma_mm"):
        load_rig("thin").replace({"prism.teeth.base_sigma_mm": sigmas})


def test_teeth_out_of_view_are_no_one_asks_for():
    # the view is 33 mm wide and rays leave two teeth further on
    assert teeth_seen(load_rig("thin")) == {2, 3, 4, 5, 6, 7}
