"""The ray shader against the exact float64 ray model, which shares nothing with it but the rig file."""

from collections.abc import Callable

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray
from small_rigs import quarter, with_tables

from zeromethod.optics import Dented, Optics, Trace
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import Layer, RestSurface, Rig
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.gpu import GpuRenderer
from zeromethod.simulation.loads import Form, Load, load, ring, rough
from zeromethod.simulation.press import Dent, Mirror, Shape

# float32 coordinates of up to 40 mm carry 2e-6 mm, 4e-5 px of 0.063 mm each; a dozen of them add up.
Q_TOLERANCE_PX = 0.005
REFLECTANCE_TOLERANCE = 2e-3

GAUSSIAN = Dent(Shape.GAUSSIAN, 38.0, 1.0, 0.2, 5.0)
BALL = Dent(Shape.BALL, 36.0, -3.0, 0.2, 8.0, contact_mm=1.26)
CONE = Dent(Shape.CONE, 40.03, 2.01, 0.1, 1.5, contact_mm=1.5, touch_reflectance=0.2)
EDGE = Dent(Shape.EDGE, 38.0, 0.0, 0.15, 2.0, length_mm=12.0, angle_deg=30.0, contact_mm=0.5)
BULGE = Dent(Shape.GAUSSIAN, 30.0, 5.0, -0.05, 3.0)


def _bump(rows: int = 17, cols: int = 25) -> NDArray[np.float64]:
    v, u = np.mgrid[-1 : 1 : rows * 1j, -1 : 1 : cols * 1j]
    return np.asarray((1 - u**2) ** 2 * (1 - v**2) ** 2 * (1 + 0.3 * u - 0.2 * v))


MAP = Dent(Shape.MAP, 37.0, 1.0, 0.15, 0.8, angle_deg=20.0, map=_bump())
SMALL_MAP = Dent(Shape.MAP, 44.0, -4.0, 0.05, 0.6, map=_bump(11, 9))

LAYER = Rubber(support="bonded", thickness_mm=7.0)
LOAD = load(38.0, 1.0, 0.2, 3.54)
SMALL_LOAD = load(37.0, 0.5, 0.004, 0.5)
ON_LAYER = load(38.0, 1.0, 0.1, 3.54, LAYER)
RING = ring(38.0, 1.0, 0.1, 6.0, 1.5, LAYER)
ROD = Load(Form.ROD, 1.5, length_mm=12.0, angle_deg=30.0, contact_mm=0.5).dent(38.0, 0.0, 0.15)
ROUGH = rough(40.0, 1.0, 0.1, 8.0, 2.0, 3)


def _compare(rig: Rig, mirror: Mirror, context: moderngl.Context) -> tuple[Trace, NDArray[np.bool_]]:
    """Assert that both models agree; returns the exact one's trace and the pixels compared."""
    renderer = GpuRenderer(rig, context)
    q, reflectance = renderer.ray_map(mirror)
    renderer.close()
    optics = Optics(rig)
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    truth = optics.trace(u, v, Dented(optics.rest, mirror))
    x, y = truth.point[..., 0], truth.point[..., 1]
    expected = truth.reflectance * mirror.reflectance_factor(x, y)
    arrived, truly = np.isfinite(q[..., 0]), np.isfinite(truth.q[..., 0])
    # a ray within rounding of a face's border may fall on either side of it
    assert np.count_nonzero(arrived != truly) <= 1e-4 * truly.size
    assert np.all(reflectance[~arrived] == 0.0)
    both = arrived & truly
    for dent in mirror.dents:
        if dent.shape is Shape.CONE:  # its slope jumps at the tip
            both &= np.hypot(x - dent.x_mm, y - dent.y_mm) > 0.05
    assert np.abs(q - truth.q)[both].max() < Q_TOLERANCE_PX
    wrong = np.abs(reflectance - expected)[both] > REFLECTANCE_TOLERANCE
    # pixels within rounding of a contact's border
    assert np.count_nonzero(wrong) <= 1e-4 * wrong.size
    return truth, both


@pytest.mark.parametrize(
    "dents",
    [
        (), (GAUSSIAN,), (BALL,), (CONE,), (EDGE,), (MAP,), (GAUSSIAN, BALL, BULGE, MAP, SMALL_MAP),
        (LOAD,), (ON_LAYER,), (RING,), (ROD,), (ROUGH,), (SMALL_LOAD, ROD, MAP, RING),
    ],
    ids=lambda dents: "+".join(dent.shape for dent in dents) or "rest",
)  # fmt: skip
def test_every_dent_agrees_with_the_exact_rays(dents, gl_context):
    _, both = _compare(quarter(), Mirror(dents), gl_context)
    assert both.mean() > 0.9


def _layers(*slabs: tuple[float, float]) -> tuple[Layer, ...]:
    return tuple(Layer(index=index, thickness_mm=thickness_mm) for index, thickness_mm in slabs)


RIGS: dict[str, Callable[[], Rig]] = {
    "paper": lambda: load_rig("paper"),
    "orthographic, rolled": lambda: quarter(
        camera={"projection": "orthographic", "pixel_mm": 0.12, "focal_px": None, "roll_deg": 4.0}
    ),
    "layers": lambda: quarter(
        pattern_layers=_layers((1.49, 2.0), (1.0, 0.5), (1.52, 0.7)),
        camera_layers=_layers((1.49, 3.0), (1.33, 1.0)),
    ),
    "no layers": lambda: quarter(pattern_layers=()),
    "distorted": lambda: quarter(camera={"distortion": (-3.0, 20.0, 0.02, -0.03, 5.0), "roll_deg": -7.0}),
    "turned lcd": lambda: quarter(
        pattern_layers=_layers((1.49, 2.0), (1.0, 6.0)),
        display={"tilt_deg": (3.0, -2.0), "turn_deg": 75.0, "mirrored": True, "centre_mm": (29.0, 2.0)},
    ),
    "panel cuts into the prism": lambda: quarter(pattern_layers=(), display={"tilt_deg": (1.0, 2.0)}),
    **{
        name: lambda radius_mm=radius_mm: quarter(
            prism={"rest": RestSurface(shape="sphere", radius_mm=radius_mm, centre_mm=(36.0, 2.0))}
        )
        for name, radius_mm in (("bulging rest", 900.0), ("hollow rest", -2000.0))
    },
    "rest bent along one axis": lambda: quarter(
        prism={"rest": RestSurface(shape="cylinder", radius_mm=600.0, centre_mm=(36.0, 2.0), axis_deg=25.0)}
    ),
}


@pytest.mark.parametrize("name", RIGS)
def test_every_bench_agrees_with_the_exact_rays(name, gl_context):
    _, both = _compare(RIGS[name](), Mirror((GAUSSIAN,)), gl_context)
    assert both.mean() > 0.3


def test_pixels_past_the_lens_models_turning_point_see_nothing(gl_context):
    rig = quarter(camera={"distortion": (-60.0, 0.0, 0.0, 0.0, 0.0)})
    renderer = GpuRenderer(rig, gl_context)
    q, _ = renderer.ray_map(Mirror())
    renderer.close()
    v, u = np.mgrid[0 : rig.camera.rows, 0 : rig.camera.columns].astype(float)
    truly = np.isfinite(Optics(rig).rest_map(u, v)[..., 0])
    assert 0.1 < truly.mean() < 0.9
    # right at the turning point Newton's method settles late
    assert np.mean(np.isfinite(q[..., 0]) != truly) < 1e-3


def test_rest_map_agrees_with_the_exact_rays_beyond_its_border_too(tmp_path, gl_context):
    heights = np.random.default_rng(1).normal(0.0, 0.01, (15, 19)) + 0.3
    np.save(tmp_path / "rest.npy", heights)
    rest = RestSurface(shape="map", file=tmp_path / "rest.npy", pitch_mm=2.5, origin_mm=(20.0, -14.0))
    _compare(quarter(prism={"rest": rest}), Mirror((GAUSSIAN,)), gl_context)


@pytest.mark.parametrize("polarisation_deg", [None, 0.0, 90.0, 30.0])
def test_reflectance_across_the_critical_angle(polarisation_deg, gl_context):
    # its centre ray is 0.17 degrees below total reflection
    rig = with_tables(load_rig("paper"), display={"polarisation_deg": polarisation_deg})
    truth, both = _compare(rig, Mirror((GAUSSIAN,)), gl_context)
    below = truth.reflectance[both] < 0.999
    assert 0.1 < below.mean() < 0.99
    assert truth.reflectance[both].min() < 0.5
