"""Rays through stacks of slabs, forward and joined between two points."""

import numpy as np
import pytest

from zeromethod.optics.layers import direction_between, through_slabs
from zeromethod.optics.vectors import dot, reflect, unit

from .optics_shapes import close

NORMAL = unit(np.array([-0.6, 0.2, -0.75]))
PLATE, BOND, AIR, GLASS = (1.49, 2.0), (1.45, 0.1), (1.0, 0.5), (1.52, 0.7)
STACKS = [[], [AIR], [PLATE], [PLATE, AIR], [BOND, PLATE, AIR], [BOND, PLATE, AIR, GLASS]]


def refract(direction, normal, n1, n2):
    """Snell's law in vector form, for normals along the travel."""
    tangential = n1 / n2 * (direction - dot(direction, normal)[:, None] * normal)
    return tangential + np.sqrt(1 - dot(tangential, tangential))[:, None] * normal


def random_directions(count, most_deg, seed=4):
    """Directions up to `most_deg` from NORMAL, all round it."""
    rng = np.random.default_rng(seed)
    angle = np.radians(rng.uniform(0.0, most_deg, count))
    across = unit(np.cross(NORMAL, rng.normal(size=(count, 3))))
    return np.cos(angle)[:, None] * NORMAL + np.sin(angle)[:, None] * across


@pytest.mark.parametrize("slabs", STACKS, ids=len)
def test_a_stack_is_its_interfaces_one_by_one(slabs):
    direction = random_directions(200, 44.0)
    expected, ray, index = np.zeros_like(direction), direction, 1.41
    for n, t in slabs:
        ray, index = refract(ray, NORMAL, index, n), n
        expected += (t / dot(ray, NORMAL))[:, None] * ray
    displacement, out = through_slabs(direction, NORMAL, 1.41, slabs, 1.3)
    # 1e-11 mm: near the critical angle, 45.17 deg, each route rounds cos = sqrt(1 - sin^2) its own way
    close(displacement, expected, 1e-11)
    close(out, refract(ray, NORMAL, index, 1.3), 1e-11)


def test_a_plate_in_air_shifts_by_the_textbook_amount():
    angle = np.radians(40.0)
    direction = np.array([[np.sin(angle), 0.0, np.cos(angle)]])
    displacement, out = through_slabs(direction, np.array([0.0, 0.0, 1.0]), 1.0, [(1.5, 3.0)], 1.0)
    inside = np.arcsin(np.sin(angle) / 1.5)
    shift = 3.0 * np.sin(angle - inside) / np.cos(inside)
    close(out, direction, 1e-15)
    perpendicular = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    assert -(displacement[0] @ perpendicular) == pytest.approx(shift, abs=1e-14)


def test_a_ray_that_a_slab_totally_reflects_or_that_runs_away_is_nan():
    direction = np.stack(
        [random_directions(1, 0.0)[0], unit(NORMAL + 1.2 * np.cross(NORMAL, [0, 1, 0])), -NORMAL]
    )
    displacement, out = through_slabs(direction, NORMAL, 1.41, [AIR], 1.41)
    assert np.isfinite(displacement[0]).all()
    assert np.isnan(displacement[1:]).all()
    assert np.isnan(out[1:]).all()


@pytest.mark.parametrize("slabs", STACKS, ids=len)
@pytest.mark.parametrize("rubber_mm", [1e-3, 1.0, 40.0])
def test_joining_two_points_finds_the_ray_that_was_sent(slabs, rubber_mm):
    least = min([1.41] + [n for n, _ in slabs])
    critical = np.degrees(np.arcsin(least / 1.41))
    direction = random_directions(300, min(critical - 1e-3, 89.0))  # up to 1e-3 deg from grazing
    stack = [(1.41, rubber_mm), *slabs]
    offset, _ = through_slabs(direction, NORMAL, 1.41, stack, 4.0)
    thicknesses = np.array([[t] * 300 for _, t in stack])
    found = direction_between(offset, NORMAL, [n for n, _ in stack], thicknesses)
    # 1e-13: machine precision after the forward trace's own roundings
    close(found, direction, 1e-13)


def test_joined_rays_obey_fermat():
    """The optical path between the points is least: n1 l1 + n2 l2 is stationary at the crossing."""
    offset = np.array([[12.0, -5.0, 20.5]])
    normal = np.array([0.0, 0.0, 1.0])
    found = direction_between(offset, normal, [1.41, 1.0], np.array([[20.0], [0.5]]))
    crossing = found[0] * 20.0 / found[0, 2]

    def optical_path(at):
        return 1.41 * np.linalg.norm(at) + np.linalg.norm(offset[0] - at)

    for step in ([1e-4, 0, 0], [0, 1e-4, 0]):
        forward, back = optical_path(crossing + step), optical_path(crossing - np.array(step))
        assert forward > optical_path(crossing)
        # third order, step^3 / (0.5 mm)^2, leaves 6e-13 mm; a crossing off by e would add 3e-4 e: e < 1e-8 mm
        assert forward - back == pytest.approx(0.0, abs=2e-12)


def test_far_points_are_reached_at_grazing_angles():
    """600 mm sideways over half a millimetre of air: sin(angle in rubber) -> 1/1.41."""
    offset = np.array([[600.0, 0.0, 20.5]])
    found = direction_between(offset, np.array([0.0, 0.0, 1.0]), [1.41, 1.0], np.array([[20.0], [0.5]]))
    displacement, _ = through_slabs(found, np.array([0.0, 0.0, 1.0]), 1.41, [(1.41, 20.0), (1.0, 0.5)], 1.0)
    # 1e-6 relative: at cos = 8.6e-4 in air, 1e-16 in the direction is 1e-10 of cos and 5e-8 mm sideways
    np.testing.assert_allclose(displacement, offset, rtol=1e-6)


def test_points_straight_ahead_and_points_that_no_ray_joins():
    normal = np.array([0.0, 0.0, 1.0])
    offset = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, 0.5], [50.0, 0.0, 1.0], [np.nan, 0.0, 2.0]])
    thicknesses = np.array([[1.0, 1.0, 1.0, 1.0], [1.0, -0.5, 0.0, 1.0]])
    found = direction_between(offset, normal, [1.41, 1.0], thicknesses)
    np.testing.assert_array_equal(found[0], normal)
    assert np.isnan(found[1:]).all()  # behind the gap; no gap at all, 50 mm aside; unknown


@pytest.mark.parametrize(("n1", "n2"), [(1.0, 1.41), (1.41, 1.0), (1.5, 1.41)])
def test_a_bare_interface_obeys_snell_and_is_reversible(n1, n2):
    angle = np.radians(np.linspace(0.0, 44.0, 45))
    up = np.array([0.0, 0.0, 1.0])
    direction = np.stack([np.sin(angle), np.zeros_like(angle), np.cos(angle)], axis=-1)
    _, out = through_slabs(direction, up, n1, [], n2)
    expected = np.arcsin(n1 / n2 * np.sin(angle))
    # 1e-14: a few roundings of numbers near 1
    close(out, np.stack([np.sin(expected), 0 * angle, np.cos(expected)], axis=-1), 1e-14)
    # going back from grazing rays loses half the digits of cos = sqrt(1 - sin^2)
    close(through_slabs(out, up, n2, [], n1)[1], direction, 1e-9)


def test_beyond_the_critical_angle_nothing_is_refracted():
    angle = np.radians([45.1, 45.2, np.nan])  # critical angle 45.17 deg at 1.41
    direction = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=-1)
    _, out = through_slabs(direction, np.array([0.0, 0.0, 1.0]), 1.41, [], 1.0)
    assert np.isfinite(out[0]).all()
    assert np.isnan(out[1:]).all()


def test_reflection_turns_only_the_part_along_the_normal():
    up, direction = np.array([0.0, 0.0, 1.0]), unit(np.array([[0.3, -0.2, 0.9], [np.nan] * 3]))
    for sense in (1, -1):
        close(reflect(direction, sense * up), direction * [1, 1, -1], 1e-16)
