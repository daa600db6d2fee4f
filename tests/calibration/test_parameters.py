import numpy as np
import pytest

from zeromethod import InputError, Optics, load_rig
from zeromethod.calibration.parameters import PARAMETERS, Priors, build, describe


@pytest.mark.parametrize("name", ["simulated", "paper", "virtual", "dome", "cylinder", "thin"])
def test_every_parameter_of_a_rig_comes_back_as_it_was_set(name):
    rig = load_rig(name)
    rng = np.random.default_rng(0)
    wanted = {
        key: value + 0.1 * (PARAMETERS[key].sigma(rig) or 0.01) * rng.standard_normal()
        for key, value in describe(rig).items()
    }
    changed = build(rig, wanted)
    # scales are relative to the rig that was changed, so they are 1 again in the new one
    scale, radius = wanted.pop("camera.scale"), wanted.pop("rest.scale", None)
    found = describe(changed)
    assert found.pop("camera.scale") == 1.0
    if radius is not None:
        assert found.pop("rest.scale") == 1.0
        assert changed.prism.rest.radius_mm == pytest.approx(radius * (rig.prism.rest.radius_mm or 0.0))
    assert found == pytest.approx(wanted, abs=1e-12)
    if rig.camera.focal_px is not None:
        assert changed.camera.focal_px[0] == pytest.approx(scale * rig.camera.focal_px[0])
    else:
        assert changed.camera.pixel_mm == pytest.approx(scale * (rig.camera.pixel_mm or 0.0))


def test_nothing_changed_is_the_same_rig():
    rig = load_rig("simulated")
    u, v = np.array([100.0, 900.0]), np.array([50.0, 800.0])
    # rounding of the direction's angles, times 300 mm
    np.testing.assert_allclose(
        Optics(build(rig, {})).rest_map(u, v), Optics(rig).rest_map(u, v), atol=1e-8, rtol=0
    )


def test_heading_turns_the_axis_from_x_to_z_and_elevation_lifts_it_to_y():
    rig = load_rig("simulated")
    straight = build(rig, {"camera.heading_deg": 180.0, "camera.elevation_deg": 30.0})
    axis = np.subtract(straight.camera.look_at_mm, straight.camera.position_mm)
    axis /= np.linalg.norm(axis)
    np.testing.assert_allclose(axis, [-np.sqrt(0.75), 0.5, 0.0], atol=1e-12)
    turned = build(rig, {"camera.heading_deg": 90.0, "camera.elevation_deg": 0.0})
    axis = np.subtract(turned.camera.look_at_mm, turned.camera.position_mm)
    np.testing.assert_allclose(axis / np.linalg.norm(axis), [0.0, 0.0, 1.0], atol=1e-12)


def test_the_captured_face_follows_the_pattern_face():
    rig = build(load_rig("simulated"), {"prism.pattern_angle_deg": 51.0})
    assert rig.prism.camera_angle_deg == pytest.approx(51.0)


def test_a_gap_is_only_what_is_air():
    rig = load_rig("simulated")
    glued = rig.model_copy(
        update={"pattern_layers": (rig.pattern_layers[-1].model_copy(update={"index": 1.5}),)}
    )
    assert "gap_mm" in describe(rig)
    assert "gap_mm" not in describe(glued)


def test_vectors_are_in_units_of_the_priors(nominal):
    priors = Priors.of(nominal, {"gap_mm": 0.02, "camera.k1": 0.0})
    assert "camera.k1" not in priors.names
    z = np.zeros(len(priors.names))
    z[priors.names.index("gap_mm")] = 2.0
    assert priors.values(z)["gap_mm"] == pytest.approx(nominal.pattern_layers[-1].thickness_mm + 0.04)


def test_what_is_not_possible_is_cut_off(nominal):
    priors = Priors.of(nominal)
    z = priors.within(np.full(len(priors.names), -50.0))
    assert priors.values(z)["gap_mm"] == 0.0


@pytest.mark.parametrize(("name", "sigma"), [("gap", 0.1), ("gap_mm", -1.0), ("gap_mm", float("nan"))])
def test_a_prior_that_cannot_be_is_refused(nominal, name, sigma):
    with pytest.raises(InputError, match=f"prior: {name}"):
        Priors.of(nominal, {name: sigma})
