"""Depth inside contacts: pressures against closed forms, planted dents carried in from around."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from planted_dents import DENTS, RADIUS_MM, ball, round_contact

from zeromethod.arrays import Float
from zeromethod.contact.deepest import deepest_of_all, with_depths
from zeromethod.contact.inside import carried_inside
from zeromethod.contact.loads import Loads
from zeromethod.surface import Anchor, Peak, Surface, Where, peak

NODES, SPACING_MM = 61, 0.3
NOISE_MM = 10e-6


@pytest.mark.parametrize("which", range(3))
def test_each_pressure_makes_its_closed_form_dent(which: int) -> None:
    contact = round_contact()
    loads = Loads.of(contact)
    dent, depth = list(DENTS.values())[which]
    r = np.concatenate([[0.0], np.linspace(1.1, 8.0, 40)]) * RADIUS_MM
    at = np.stack([r, np.zeros_like(r)], axis=-1)
    made = loads.depth(at)
    own = made[:, 0] if which == 0 else made[:, 0] + made[:, which]
    # beside a rim the field of 40 rays is that of beads: 1 % at a ninth of the radius
    np.testing.assert_allclose(own, np.pi * depth / RADIUS_MM * dent(r, RADIUS_MM), rtol=0.015)


def test_slopes_are_those_of_the_depths() -> None:
    loads = Loads.of(round_contact())
    at = np.array([[1.3, 0.4], [-2.0, 1.0], [0.2, 3.0]])
    step = 1e-5
    for k in range(2):
        moved = np.eye(2)[k] * step
        rise = (loads.depth(at + moved) - loads.depth(at - moved)) / (2 * step)
        np.testing.assert_allclose(loads.slope(at)[..., k], rise, rtol=1e-6, atol=1e-7)


class Places:
    """Nodes that do not move with depth."""

    def __init__(self, points: Float) -> None:
        self._points = points

    def at_depth(self, nodes: Any, depth_mm: Float) -> Float:
        return np.asarray(self._points[nodes])


def pressed(depth: Float, x: Float, y: Float, holes: Any) -> tuple[Surface, Places]:
    noise = np.random.default_rng(5).normal(0, NOISE_MM, depth.shape)
    valid = ~holes
    flat = np.zeros((*depth.shape, 2))
    surface = Surface(
        np.where(valid, depth + noise, np.nan), flat, x, y,
        np.where(valid, 3 * NOISE_MM, np.nan), flat, valid, holes,
        Anchor("none", np.zeros(depth.shape, bool), 0.0), 0, 1,
    )  # fmt: skip
    return surface, Places(np.stack([x, y], axis=-1))


def lattice() -> tuple[Float, Float]:
    line = (np.arange(NODES) - NODES // 2) * SPACING_MM
    x, y = np.meshgrid(line, line)
    return x, y


@pytest.mark.parametrize("name", list(DENTS))
@pytest.mark.parametrize("lost_mm", [0.0, 0.6])
def test_a_planted_dent_is_carried_in_within_its_sigma(name: str, lost_mm: float) -> None:
    x, y = lattice()
    r, depth_mm = np.hypot(x, y), 0.02
    dent = depth_mm * DENTS[name][0](r, RADIUS_MM)
    surface, places = pressed(dent + 1e-4 * x, x, y, r < RADIUS_MM + lost_mm)
    inside = carried_inside(surface, [round_contact()], places)  # type: ignore[arg-type]
    assert inside is not None
    assert (inside.valid == (r < RADIUS_MM + lost_mm)).all()
    z = (inside.depth_mm - dent - 1e-4 * x)[inside.valid] / inside.sigma_depth_mm[inside.valid]
    assert np.abs(z).max() < 3
    # sigma is no excuse: less than linear extrapolation and nothing differ by, and growing inwards
    assert inside.sigma_depth_mm[NODES // 2, NODES // 2] < 0.5 * depth_mm
    rim = inside.valid & (r > RADIUS_MM + lost_mm - SPACING_MM)
    assert np.median(inside.sigma_depth_mm[rim]) < inside.sigma_depth_mm[inside.valid].max() / 2


def test_the_depth_of_a_ball_is_known_where_nodes_are_read_up_to_its_border() -> None:
    x, y = lattice()
    r = np.hypot(x, y)
    surface, places = pressed(0.02 * ball(r, RADIUS_MM), x, y, r < RADIUS_MM)
    contact = round_contact()
    inside = carried_inside(surface, [contact], places)  # type: ignore[arg-type]
    surface = replace(surface, inside=inside)
    found, measured = deepest_of_all(surface, peak(surface)), peak(surface)
    assert found.where is Where.INSIDE
    assert found.depth_mm == pytest.approx(0.02, abs=3 * found.sigma_mm)
    assert found.depth_mm > 1.5 * measured.depth_mm
    assert with_depths(surface, [contact])[0].depth_mm == found.depth_mm


def test_two_contacts_are_distinguished_by_their_common_dent() -> None:
    x, y = lattice()
    apart = 2.2
    r, other = np.hypot(x - apart, y), np.hypot(x + apart, y)
    dent = 0.02 * ball(r, RADIUS_MM) + 0.01 * ball(other, RADIUS_MM)
    surface, places = pressed(dent, x, y, (r < 1.2) | (other < 1.2))
    contacts = [round_contact(apart), round_contact(-apart)]
    inside = carried_inside(surface, contacts, places)  # type: ignore[arg-type]
    assert inside is not None
    first, second = with_depths(replace(surface, inside=inside), contacts)
    for contact, own in ((first, r), (second, other)):
        true = dent[own < RADIUS_MM].max()
        assert abs(contact.depth_mm - true) < 3 * contact.sigma_depth_mm < true


def test_a_peak_beside_a_contact_of_unknown_depth_says_so() -> None:
    x, y = lattice()
    r = np.hypot(x, y)
    surface, _ = pressed(0.02 * ball(r, RADIUS_MM), x, y, r < RADIUS_MM)
    assert deepest_of_all(surface, peak(surface)).where is Where.BESIDE
    away = Peak(0.01, 6.0, 6.0, 1e-4)
    assert deepest_of_all(surface, away).where is Where.MEASURED


def test_nothing_is_said_of_a_contact_that_leaves_too_little_to_read() -> None:
    x, y = lattice()
    r = np.hypot(x, y)
    surface, places = pressed(0.02 * ball(r, 6.0), x, y, r < 8.4)
    assert carried_inside(surface, [round_contact(radius_mm=6.0)], places) is None  # type: ignore[arg-type]
