"""The mirror's edges in the image: found where they are, and never where something else ends the picture."""

from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from small_rigs import with_tables

from benchmarks import calibration_study as study
from zeromethod import NodeGrid, Optics, RestMeasurement, Rig, binned, load_rig
from zeromethod.calibration import Fit, MirrorEdge, Priors, RestPositions, fit
from zeromethod.calibration.edges import EdgeSearch, NoEdge, find_edges
from zeromethod.calibration.rays import UnboundedOptics, mirror_point
from zeromethod.decoding import Reason
from zeromethod.decoding.noise import NoiseModel
from zeromethod.warp.rest_map import RestMap

WIDE_FOCAL_PX, BINNING = 5600.0, 8
LCD_NOISE_PX, LIGHT = 0.05, 50.0


def wide(focal_px: float = WIDE_FOCAL_PX) -> Rig:
    """The packaged bench by a lens that sees both edges, 160 x 128 px, on an LCD of half the resolution."""
    lcd = {"columns": 960, "rows": 540, "pitch_mm": 0.126}
    camera = {"focal_px": (focal_px, focal_px)}
    return binned(with_tables(load_rig("simulated"), camera=camera, display=lcd, scenario="none"), BINNING)


def mesh(rig: Rig) -> tuple[np.ndarray, np.ndarray]:
    v, u = np.mgrid[: rig.camera.rows, : rig.camera.columns].astype(float)
    return u, v


def measured(
    rig: Rig, light: np.ndarray, rng: np.random.Generator, lcd_px: np.ndarray | None = None
) -> RestMeasurement:
    """What phase shifting gives of a bench whose fringes are seen with an amplitude of `light`."""
    shape = light.shape
    lcd = Optics(rig).rest_map(*mesh(rig)) if lcd_px is None else lcd_px
    size = np.array([rig.display.columns, rig.display.rows])
    seen = np.isfinite(lcd).all(axis=-1)
    with np.errstate(invalid="ignore"):
        on_lcd = ((lcd > -0.5) & (lcd < size - 0.5)).all(axis=-1)
    light = np.where(seen & ~on_lcd, 0.0, light)
    valid = on_lcd & (light > 0.2 * LIGHT)
    lcd = np.where(valid[..., None], lcd + LCD_NOISE_PX * rng.standard_normal(lcd.shape), np.nan)
    sigma = np.where(valid[..., None], LCD_NOISE_PX, np.nan) * np.ones(2)
    reason = np.where(valid, 0, int(Reason.NO_MODULATION)).astype(np.uint16)
    amplitude = np.maximum(light + 0.5 * rng.standard_normal(shape), 0.0).astype(np.float32)
    nothing = np.zeros(shape, np.float32)
    return RestMeasurement(
        rest_map=RestMap(lcd, sigma, valid, reason), amplitude=amplitude, mean=amplitude, odds=nothing,
        reflection=nothing, noise=NoiseModel(4.0, 0.0), noise_found=True, scatter_ratio=1.0,
        second_harmonic=0.0, folded_harmonic=0.0, light_drift=0.0, flicker=0.0, phase_sigma_rad=0.01,
        order_error=0.0, size_px=(float(size[0]), float(size[1])),
    )  # fmt: skip


def fitted_to(nominal: Rig, found: RestMeasurement) -> Fit:
    grid = NodeGrid((nominal.camera.rows, nominal.camera.columns), 8)
    return fit(Priors.of(nominal), [RestPositions.of(grid, found.rest_map.warp(grid))])


def searched(nominal: Rig, found: RestMeasurement) -> tuple[EdgeSearch, EdgeSearch]:
    return find_edges(fitted_to(nominal, found), found)


def off_sigma(search: EdgeSearch, true: Rig) -> np.ndarray:
    """Distance of the points found from the true edge, in the sigma stated for their mean."""
    assert isinstance(search.found, MirrorEdge), search.words
    return np.asarray(search.found.predict(true) / search.found.sigma)


def mirror_light(rig: Rig, blur_px: float = 0.0) -> np.ndarray:
    """Light of the mirror, seen out of focus."""
    lit = np.isfinite(Optics(rig).rest_map(*mesh(rig))[..., 0])
    fine = lit.astype(float)
    return LIGHT * (gaussian_filter(fine, blur_px, mode="nearest") if blur_px else fine)


@pytest.fixture(scope="module")
def drawn() -> list[Rig]:
    """Benches that stand otherwise than the rig file says, both edges in view of each."""
    rng, benches = np.random.default_rng(21), list[Rig]()
    while len(benches) < 3:
        bench = study.draw(wide(), rng)
        optics = UnboundedOptics(bench)
        x = mirror_point(optics, np.array([15.0, 144.0]), np.array([64.0, 64.0]))[:, 0]
        if x[0] < 0.0 and x[1] > optics.length_mm:
            benches.append(bench)
    return benches


def test_edges_are_found_within_their_sigma(drawn):
    rng = np.random.default_rng(5)
    away = []
    for bench in drawn:
        found = searched(wide(), measured(bench, mirror_light(bench), rng))
        away += [off_sigma(one, bench) for one in found]
        sigmas = [one.found.sigma_px for one in found if isinstance(one.found, MirrorEdge)]
        # pixels of 0.8 mm on the mirror: a third of one, and what a cast edge is
        assert max(sigmas) < 1.0
    # A step on the pixels' grid is off by up to half of one; 12 points, none beyond three sigma.
    assert np.abs(away).max() < 3.0
    assert 0.2 < np.sqrt(np.mean(np.square(away))) < 1.3


def test_a_blurred_edge_is_found_to_parts_of_a_pixel(drawn):
    rng, away = np.random.default_rng(6), []
    for bench in drawn[:2]:
        found = searched(wide(), measured(bench, mirror_light(bench, 1.5), rng))
        for one in found:
            assert isinstance(one.found, MirrorEdge), one.words
            away.append(np.mean(one.found.predict(bench)))
    # the grid of the true picture itself is a pixel wide: 0.29 px
    assert np.sqrt(np.mean(np.square(away))) < 0.35


def test_edges_bring_what_the_rest_map_leaves_open(drawn):
    bench = drawn[0]
    found = measured(bench, mirror_light(bench), np.random.default_rng(7))
    grid = NodeGrid((bench.camera.rows, bench.camera.columns), 8)
    rest = RestPositions.of(grid, found.rest_map.warp(grid))
    before = fit(Priors.of(wide()), [rest])
    edges = [one.found for one in find_edges(before, found) if isinstance(one.found, MirrorEdge)]
    after = fit(Priors.of(wide()), [rest, *edges])
    assert after.settled
    # the LCD's place along x and the camera's: unknown by 1.2 mm without
    assert after.sigma["display.along_mm"] < 0.5 * before.sigma["display.along_mm"]
    true = bench.display.centre_mm[0]
    assert abs(after.values["display.along_mm"] - true) < 3.0 * after.sigma["display.along_mm"]


def test_camera_on_its_side_finds_them_along_rows(drawn):
    upright = drawn[1]

    def turned(rig: Rig) -> Rig:
        camera = rig.camera
        update: dict[str, Any] = {
            "columns": camera.rows,
            "rows": camera.columns,
            "centre_px": (camera.rows - 1 - camera.centre_px[1], camera.centre_px[0]),
            "roll_deg": camera.roll_deg - 90.0,
        }
        return with_tables(rig, camera=update)

    bench, nominal = turned(upright), turned(wide())
    found = searched(nominal, measured(bench, mirror_light(bench), np.random.default_rng(8)))
    for one in found:
        assert one.words.startswith("found at row ")
        assert np.abs(off_sigma(one, bench)).max() < 3.0


def test_packaged_lens_sees_no_edge_and_finds_none():
    rig = wide(9000.0)
    found = searched(rig, measured(rig, mirror_light(rig), np.random.default_rng(9)))
    assert [one.found for one in found] == [NoEdge.NOT_IN_VIEW, NoEdge.NOT_IN_VIEW]


def shaded(kind: str, rig: Rig) -> np.ndarray:
    """Light of a bench that sees no edge, ended by something else near where P0 might be."""
    u, v = mesh(rig)
    light = mirror_light(rig)
    middle = 0.5 * (rig.camera.rows - 1)
    if kind == "vignetting":
        return light * np.clip((u + 5.0) / 45.0, 0.0, 1.0)
    if kind == "aperture":
        return light * (np.hypot(u - 88.0, v - middle) < 84.0)
    if kind == "slanted stop":
        return light * (u - 8.0 > 0.35 * (v - middle))
    if kind == "ragged":
        rng = np.random.default_rng(3)
        return light * (u > rng.uniform(2.0, 14.0, (rig.camera.rows, 1)))
    return light * (u > 3.0)  # past it there is too little to separate darkness from the image's end


@pytest.mark.parametrize("kind", ["vignetting", "aperture", "slanted stop", "ragged", "image's end"])
def test_other_ends_of_the_picture_are_no_edge(kind):
    rig = wide(8000.0)
    found = searched(rig, measured(rig, shaded(kind, rig), np.random.default_rng(10)))
    assert isinstance(found[0].found, NoEdge)


def test_the_end_of_the_lcd_is_no_edge():
    """An LCD that ends 1.5 mm before the edge P0 does on the pattern face: what is seen is its end."""
    rig = wide()
    u, v = mesh(rig)
    lcd = Optics(rig).rest_map(u, v)
    optics = UnboundedOptics(rig)
    x = mirror_point(optics, u, v)[..., 0]
    first = float(np.nanmin(lcd[(x > 0.5) & (x < 1.5), 0]))
    shifted = rig.display.centre_mm[0] + first * rig.display.pitch_mm
    short = with_tables(rig, display={"centre_mm": (shifted, 0.0)})
    found = searched(short, measured(short, mirror_light(short), np.random.default_rng(11)))
    assert found[0].found is NoEdge.LCD_ENDS
    assert isinstance(found[1].found, MirrorEdge)


def test_hand_of_dust_on_the_edge_does_not_move_it(drawn):
    bench = drawn[2]
    light = mirror_light(bench)
    place = searched(wide(), measured(bench, light, np.random.default_rng(12)))[0]
    assert isinstance(place.found, MirrorEdge)
    column = round(float(place.found.pixel[:, 0].mean()))
    light[30:50, column - 6 : column + 8] = 0.0
    again = searched(wide(), measured(bench, light, np.random.default_rng(12)))[0]
    assert np.abs(off_sigma(again, bench)).max() < 3.0
