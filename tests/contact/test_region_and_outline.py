"""Contacts in made-up frames: found, nothing else called one, outlined to a fraction of a pixel."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from zeromethod import load_rig
from zeromethod.contact.outline import first_outline, refined, signed_area
from zeromethod.contact.region import Region, RegionFinder
from zeromethod.contact.rest import FRAMES, RestPicture
from zeromethod.rig.model import Rig
from zeromethod.sensing.sensor import ResidualSensor
from zeromethod.warp.grid import NodeGrid

ROWS, COLS, PERIOD = 256, 320, 16
MEAN, CONTRAST, BLACK, READ = 100.0, 0.9, 4.0, 2.0
BLUR_PX = 0.7
V, U = np.mgrid[:ROWS, :COLS].astype(float)


@pytest.fixture(scope="module")
def rig() -> Rig:
    values = {"camera.columns": COLS, "camera.rows": ROWS, "camera.centre_px": [159.5, 127.5]}
    return load_rig("simulated").replace(values)


class Bench:
    """Frames of a target with phases shifted where asked, and what the finder makes of them."""

    def __init__(self, rig: Rig) -> None:
        self.grid = NodeGrid.of_rig(rig)
        self.sensor = ResidualSensor.from_rig(rig, self.grid)
        self.rest = RestPicture(rig, self.grid)
        self.finder = RegionFinder(rig, self.grid, BLUR_PX)
        self.draw = np.random.default_rng(1)

    def frame(
        self, covered=0.0, scattered=8.0, shift=0.0, gain=1.0, dirt=1.0, contrast=CONTRAST
    ) -> np.ndarray:
        phase_u, phase_v = (2 * np.pi * (axis + shift) / PERIOD for axis in (U, V))
        picture = MEAN * (1 + contrast * (np.cos(phase_u) + np.cos(phase_v)) / 2)
        light = BLACK + gain * dirt * (covered * scattered + (1 - covered) * picture)
        return np.clip(np.rint(light + self.draw.normal(0, READ, light.shape)), 0, 255).astype(np.uint8)

    def learn(self, **frame) -> None:
        for _ in range(FRAMES):
            image = self.frame(**frame)
            self.rest.add(image, self.sensor.measure(image))
        assert self.rest.known

    def regions(self, image: np.ndarray):
        return self.finder.find(image, self.sensor.measure(image), self.rest)


@pytest.fixture
def bench(rig) -> Bench:
    return Bench(rig)


def disc(radius_px: float, u: float = 160.3, v: float = 121.8) -> np.ndarray:
    finer = 4
    fine = (np.arange(finer) + 0.5) / finer - 0.5
    parts = [np.hypot(U + a - u, V + b - v) < radius_px for a in fine for b in fine]
    return gaussian_filter(np.mean(parts, axis=0), np.sqrt(BLUR_PX**2 - 1 / 12))


@pytest.mark.parametrize("scattered", [1.0, 8.0, 26.0])
@pytest.mark.parametrize("radius_px", [12.0, 25.0])
def test_a_discs_border_is_found_to_a_fraction_of_a_pixel_whatever_the_pictures_phase(
    bench, scattered, radius_px
):
    bench.learn()
    # beside a contact the picture is off by what the mirror bends
    distance = np.hypot(U - 160.3, V - 121.8)
    image = bench.frame(
        disc(radius_px), scattered, shift=6 * np.exp(-np.maximum(distance - radius_px, 0) / 8)
    )
    (region,) = bench.regions(image)
    outline = refined(first_outline(region.mask), region.columns, region.model)
    u, v = (outline.points_px + np.array([region.left, region.top])).T
    off = np.hypot(u - 160.3, v - 121.8) - radius_px
    # stripes of the picture as dark as the object pull at it: by 0.06 px if that is black, 0.12 px if white
    assert abs(off.mean()) < 0.15
    assert off.std() < 0.45
    assert abs(signed_area(outline.points_px) / (np.pi * radius_px**2) - 1) < 0.02
    assert np.hypot(off.mean(), off.std()) < 3 * outline.sigma_px
    assert region.scattered == pytest.approx(scattered / MEAN, abs=0.01)


@pytest.mark.parametrize("radius_px", [7.0, 8.0, 10.0])
def test_a_small_contact_is_not_read_too_small_where_the_picture_beside_is_even(bench, radius_px):
    """Beside a steep border the picture is too fine to be seen. Blur, smoothing and chords each took some of
    a border that bends: together 0.15 px. 0.08: twice the scatter of single frames."""
    bench.learn()
    places = (160.3, 121.8), (164.9, 127.1), (156.0, 118.4)
    images = [
        bench.frame(disc(radius_px, *at), contrast=CONTRAST * far_from(*at, radius_px)) for at in places
    ]
    found = [region for image in images for region in bench.regions(image)]
    outlines = [refined(first_outline(one.mask), one.columns, one.model) for one in found]
    radii = [np.sqrt(signed_area(one.points_px) / np.pi) for one in outlines]
    assert len(radii) == len(places)
    assert np.mean(radii) == pytest.approx(radius_px, abs=0.08)


def far_from(u: float, v: float, radius_px: float) -> np.ndarray:
    """From 0 at a disc's border to 1 some pixels beside."""
    return 1 - np.exp(-np.maximum(np.hypot(U - u, V - v) - radius_px, 0) / 6)


def test_probability_is_near_one_inside_and_near_none_outside(bench):
    bench.learn()
    (region,) = bench.regions(bench.frame(disc(25.0)))
    distance = np.hypot(U - 160.3, V - 121.8)
    rows, cols = region.mask.shape
    distance = distance[region.top : region.top + rows, region.left : region.left + cols]
    assert region.probability[distance < 21].min() > 0.99
    assert np.quantile(region.probability[distance > 29], 0.99) < 0.01


NOT_CONTACTS = {
    "nothing": {},
    "drift of light": {"gain": 0.9},
    "a picture that is off": {"shift": 5.0},
    "saturation": {"gain": 3.0},
    "a fold, where the picture is too fine": {"contrast": 1 - 0.999 * disc(25.0)},
}


@pytest.mark.parametrize("name", NOT_CONTACTS)
def test_what_is_not_a_contact_is_not_called_one(bench, name):
    bench.learn()
    assert bench.regions(bench.frame(**NOT_CONTACTS[name])) == []


def test_a_contact_is_found_in_light_that_has_drifted(bench):
    bench.learn()
    (region,) = bench.regions(bench.frame(disc(25.0), gain=0.8))
    assert np.count_nonzero(region.mask) == pytest.approx(np.pi * 25**2, rel=0.1)


def test_dirt_that_was_there_at_rest_is_no_contact_and_a_contact_beside_it_is(bench):
    dirt = 1 - 0.97 * disc(12.0, 80.0, 200.0)
    bench.learn(dirt=dirt)
    assert bench.regions(bench.frame(dirt=dirt)) == []
    (region,) = bench.regions(bench.frame(disc(20.0), dirt=dirt))
    rows, cols = np.nonzero(region.mask)
    assert (cols.mean() + region.left, rows.mean() + region.top) == pytest.approx((160.3, 121.8), abs=1.0)


def test_the_dark_slope_beside_a_white_object_is_its_shadow(bench):
    bench.learn()
    white, dark = disc(20.0), disc(18.0, 190.0)
    image = bench.frame(white, 26.0).astype(float)
    image = np.rint(image * (1 - dark * (1 - white)) + BLACK * dark * (1 - white)).astype(np.uint8)
    (region,) = bench.regions(image)
    assert region.scattered > 0.2


def test_a_contact_hardly_wider_than_a_flat_place_is_found(bench):
    bench.learn()
    (region,) = bench.regions(bench.frame(disc(7.0)))
    outline = refined(first_outline(region.mask), region.columns, region.model)
    # 0.07 px, where single frames scatter by 0.03
    assert signed_area(outline.points_px) == pytest.approx(np.pi * 7**2, rel=0.02)


@pytest.mark.parametrize("scattered", [1.0, 8.0])
def test_dirt_on_a_contacts_border_hardly_changes_it(bench, scattered):
    """Dirt is no contact, but what it hides of one is: without that it would lack 14 %. A line across 20 px
    of dirt lacks 2 px of a border that bends, which the border on either side makes up for: 1.3 % is left."""
    dirt = 1 - 0.97 * disc(8.0, 160.3, 137.8)
    bench.learn(dirt=dirt)
    (region,) = bench.regions(bench.frame(disc(20.0), scattered, dirt=dirt))
    outline = refined(first_outline(region.mask), region.columns, region.model)
    assert signed_area(outline.points_px) == pytest.approx(np.pi * 20**2, rel=0.025)


@pytest.mark.parametrize("angle_deg", [20.0, 65.0, 135.0])
def test_a_rods_narrow_contact_is_found_with_its_area(bench, angle_deg):
    """8 x 22 px, 1.5 mm^2 on the bench of `benchmarks.touches`. 10 %: all of the border off by its sigma."""
    bench.learn()
    along, across = turned(angle_deg)
    (region,) = bench.regions(bench.frame(blurred((abs(along) < 11) & (abs(across) < 4)), 1.0))
    outline = refined(first_outline(region.mask), region.columns, region.model)
    assert signed_area(outline.points_px) == pytest.approx(8 * 22, rel=0.1)


@pytest.mark.parametrize("place", [(160.0, 120.0), (168.0, 136.0), (168.0, 120.0), (164.0, 124.0)])
def test_a_small_contact_is_found_wherever_it_lies_in_the_picture(bench, place):
    """Where the picture is dark, it takes little of the carrier."""
    bench.learn()
    (region,) = bench.regions(bench.frame(disc(6.0, *place), 1.0))
    rows, cols = np.nonzero(region.mask)
    assert (cols.mean() + region.left, rows.mean() + region.top) == pytest.approx(place, abs=1.0)


def turned(angle_deg: float) -> tuple[np.ndarray, np.ndarray]:
    """(along, across) px from (160.3, 121.8)."""
    cos, sin = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return cos * (U - 160.3) + sin * (V - 121.8), cos * (V - 121.8) - sin * (U - 160.3)


def blurred(covered: np.ndarray) -> np.ndarray:
    return gaussian_filter(covered.astype(float), BLUR_PX)


def test_two_objects_are_two_regions_each_with_its_light(bench):
    bench.learn()
    image = bench.frame(disc(20.0, 90.0), 8.0).astype(int)
    image = np.where(disc(20.0, 230.0) > 0.5, bench.frame(disc(20.0, 230.0), 26.0), image).astype(np.uint8)
    found = sorted(region.scattered for region in bench.regions(image))
    assert found == pytest.approx([0.08, 0.26], abs=0.01)


def test_what_closes_over_between_three_regions_is_none_of_them(bench):
    """Gaps of less than a period are closed; here one closes to a piece of no region."""
    v, u = np.mgrid[:60, :60]
    masks = [np.hypot(v - at_v, u - at_u) < r for at_v, at_u, r in ((33, 19, 4), (39, 34, 5), (22, 41, 4))]
    regions = [Region(0, 0, one, one.astype(np.float32), one.view(np.uint8), None, 8.0) for one in masks]
    found = bench.finder._together(regions)
    assert [np.count_nonzero([(one.mask & mask).any() for mask in masks]) for one in found] == [1, 2]
