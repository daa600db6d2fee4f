import numpy as np
import pytest

from zeromethod import InputError, Optics, load_rig
from zeromethod.calibration import Direct, Intrinsics, MirrorEdge, Priors, RestReading
from zeromethod.calibration.fitting import jacobian
from zeromethod.calibration.measurements import MARGIN_MM, well_inside
from zeromethod.calibration.rays import UnboundedOptics, mirror_point


def test_the_rest_map_is_that_of_the_rig(truth, positions):
    left = (positions.predict(truth.rig) - positions.measured) / positions.sigma
    # planted noise of exactly the stated sigma: chi-squared of 2000 numbers is known to 3 %
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.12)


def test_rays_without_borders_are_the_rays_where_there_are_none():
    rig = load_rig("simulated")
    u, v = np.meshgrid(np.linspace(0, 1279, 9), np.linspace(0, 1023, 7))
    bounded = Optics(rig).rest_map(u, v)
    np.testing.assert_array_equal(UnboundedOptics(rig).rest_map(u, v), bounded)
    # 100 px beyond R0 the mirror has ended, its plane has not
    beyond = np.array([1550.0]), np.array([500.0])
    assert np.isnan(Optics(rig).trace(*beyond, Optics(rig).rest).q).all()
    optics = UnboundedOptics(rig)
    assert mirror_point(optics, *beyond)[0, 0] > optics.length_mm


def test_nodes_near_the_edges_are_left_out(truth, positions):
    chosen = positions.prepared(truth.rig)
    point = mirror_point(truth.optics, chosen.pixel[:, 0], chosen.pixel[:, 1])
    assert point[:, 0].min() > MARGIN_MM
    assert point[:, 0].max() < truth.optics.length_mm - MARGIN_MM
    # a pixel that looks at x < 0
    assert not well_inside(truth.rig, np.array([[-200.0, 128.0]])).any()


@pytest.mark.parametrize("edge", ["P0", "R0"])
def test_an_edge_is_given_in_camera_px_from_its_image(nominal, edge):
    optics = UnboundedOptics(nominal)
    u, v = np.linspace(-100, 450, 200001), np.full(200001, 127.5)
    x = mirror_point(optics, u, v)[:, 0]
    place = u[np.argmin(np.abs(x - (0.0 if edge == "P0" else optics.length_mm)))]
    seen = MirrorEdge(edge, np.array([[place, 127.5], [place + 1.5, 127.5]]), 2.0)
    # the search's own step is 0.003 px; u grows with x
    np.testing.assert_allclose(seen.predict(nominal), [0.0, 1.5], atol=0.01)


def test_covariance_of_the_intrinsics_is_honoured(nominal):
    focal = np.array(nominal.camera.focal_px)
    covariance = np.array([[100.0, 90.0], [90.0, 100.0]])
    data = Intrinsics(("fx", "fy"), focal + np.array([5.0, -5.0]), covariance)
    left = (data.predict(nominal) - data.measured) / data.sigma
    wanted = np.array([5.0, -5.0]) @ np.linalg.solve(covariance, [5.0, -5.0])
    assert left @ left == pytest.approx(wanted)


PAPER, ONE, SADDLE = load_rig("paper"), (np.ones(1), np.eye(1)), np.array([[1.0, 2.0], [2.0, 1.0]])


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Intrinsics(("fx", "fy"), np.ones(2), SADDLE), "positive definite"),
        (lambda: Intrinsics(("f",), *ONE), "one value for each"),
        (lambda: Intrinsics(("fx",), *ONE).prepared(PAPER), "perspective"),
        (lambda: Direct("gap", 0.5, 0.1), "not a parameter"),
        (lambda: Direct("gap_mm", 0.5, 0.0), "above 0"),
        (lambda: Direct("camera.k1", 0.0, 0.1).prepared(PAPER), "has none"),
    ],
)
def test_measurements_that_cannot_be_are_refused(make, words):
    with pytest.raises(InputError, match=words):
        make()


def test_a_press_is_read_through_the_true_rig_as_it_is(truth, presses):
    found = presses.prepared(truth.rig).predict(truth.rig)
    # nodes 1.6 mm apart on a pad of sigma 5 mm: the quartic's bias is 0.04 %; noise 0.05 %
    np.testing.assert_allclose(found, 0.2, rtol=2e-3)


def test_where_the_camera_points_has_no_part_in_the_reading(nominal, presses):
    """What `blind_to` claims: on the rays that the rest names, only the camera's place counts."""
    ready = presses.prepared(nominal)
    priors = Priors.of(nominal)
    for name in ready.blind_to & set(priors.names):
        z = 0.1 * np.array([one == name for one in priors.names])
        # reading settles within 0.1 nm, rays within 1e-9 px
        np.testing.assert_allclose(
            ready.predict(priors.at(z)), ready.predict(nominal), rtol=1e-5, err_msg=name
        )
    moved = ready.predict(priors.at(0.5 * np.array([one == "display.along_mm" for one in priors.names])))
    # 0.6 mm at 4 to 5 % per mm
    assert np.all(np.abs(moved / ready.predict(nominal) - 1.0) > 0.01)


def test_derivatives_are_those_of_the_prediction(nominal, positions):
    """One step in a random direction, 20 times smaller than the jacobian's own."""
    priors = Priors.of(nominal)
    data = positions.prepared(nominal)
    rng = np.random.default_rng(2)
    way = rng.standard_normal(len(priors.names))
    z = 0.1 * rng.standard_normal(len(priors.names))
    step = 5e-4
    change = (data.predict(priors.at(z + step * way)) - data.predict(priors.at(z - step * way))) / data.sigma
    predicted = jacobian(priors, z, data) @ way
    # central differences at 0.01 prior sigma are good to its square times the third derivative
    np.testing.assert_allclose(change / (2 * step), predicted, atol=1e-5 * np.abs(predicted).max())


def test_derivatives_at_a_bound_are_one_sided(nominal):
    priors = Priors.of(nominal)
    z = priors.within(np.array([-9.0 if name == "gap_mm" else 0.0 for name in priors.names]))
    slope = jacobian(priors, z, Direct("gap_mm", 0.5, 0.1))
    # prior sigma over the gauge's
    assert slope[0, priors.names.index("gap_mm")] == pytest.approx(1.7)
    assert np.count_nonzero(slope) == 1


def test_nothing_measured_at_rest_is_nothing_to_read(truth):
    reading = RestReading(truth.grid, np.full((*truth.grid.shape, 2), np.nan))
    with pytest.raises(InputError, match="no camera pixel"):
        reading.prepared(truth.rig).reader(truth.rig)
