"""Depth inside contacts: pressures against closed forms, planted dents carried in from around."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from planted_dents import DENTS, LINE, NOISE, RADIUS_MM, outwards, overlapping, rig, round_contact

from zeromethod.arrays import Float
from zeromethod.contact import Contact, ContactFinder, ForceReader
from zeromethod.contact.deepest import deepest_of_all
from zeromethod.contact.inside import carried_inside
from zeromethod.contact.load_fields import load_fields
from zeromethod.contact.loads import Loads
from zeromethod.surface import Anchor, Peak, Surface, Where, peak

NOISE_MM = 10e-6


@pytest.mark.parametrize("which", range(3))
def test_each_pressure_makes_its_closed_form_dent(which: int) -> None:
    loads = Loads.of(round_contact())
    dent, depth = list(DENTS.values())[which]
    for r, within in (
        (np.concatenate([[0.0], np.linspace(1.1, 8.0, 40)]), False),
        (np.linspace(0.0, 0.9, 40), True),
    ):
        at = RADIUS_MM * np.stack([r, np.zeros_like(r)], axis=-1)
        made = load_fields(loads, at, np.zeros_like(at), within=within)[:, 0]
        own = made[:, 0] if which == 0 else made[:, 0] + made[:, which]
        true = np.pi * depth / RADIUS_MM * dent(r * RADIUS_MM, RADIUS_MM)
        # beside a rim the field of 40 rays is that of beads: 1 % at a ninth of the radius; inside, cells are
        # as wide as a tenth of it: 5 %, and 7 % next to a cone's tip
        np.testing.assert_allclose(own, true, rtol=0.08 if within else 0.015)


@pytest.mark.parametrize("within", [False, True])
def test_slopes_are_those_of_the_depths(within: bool) -> None:
    loads, step = Loads.of(round_contact()), 1e-5
    at = np.array([[1.3, 0.4], [-2.0, 1.0], [0.2, 3.0], [0.3, 0.2]])

    def fields(places: Float) -> Float:
        return load_fields(loads, places, np.zeros_like(places), within=within)

    for k in range(2):
        moved = np.eye(2)[k] * step
        rise = (fields(at + moved)[:, 0] - fields(at - moved)[:, 0]) / (2 * step)
        np.testing.assert_allclose(fields(at)[:, 1 + k], rise, rtol=1e-5, atol=1e-6)


def test_means_over_blocks_of_nodes_have_their_size() -> None:
    """Of 8 x 8 nodes 6 mm away, against the mean of all 64: its slopes differ from the middle's by 1 %."""
    loads, line = Loads.of(round_contact()), 0.3 * (np.arange(8) - 3.5)
    nodes = np.stack(np.meshgrid(4.0 + line, 4.5 + line), axis=-1).reshape(-1, 2)
    middle, spread = nodes.mean(axis=0)[None], nodes.var(axis=0)[None]
    true = load_fields(loads, nodes, np.zeros_like(nodes))[:, 1:].mean(axis=0)
    alone, block = (load_fields(loads, middle, one)[0, 1:] for one in (np.zeros((1, 2)), spread))
    size = np.abs(true[:, 0]).max()
    assert np.abs(block - true).max() < 0.0025 * size
    assert np.abs(alone - true).max() > 0.008 * size


class Places:
    """Nodes that do not move with depth."""

    def __init__(self, points: Float) -> None:
        self._points = points

    def at_depth(self, nodes: Any, depth_mm: Float) -> Float:
        return np.asarray(self._points[nodes])


def pressed(*dents: tuple[str, float, float], holes_mm: float = 0.0) -> tuple[Surface, Places, Float]:
    """A mirror with dents (name, depth mm, x mm) on the x axis, unread so far beyond borders; the true depth.

    With a slight tilt of depth, and a constant that slopes do not know.
    """
    x, y = np.meshgrid(LINE, LINE)
    true, slope = 1e-4 * x + 3e-4, NOISE * overlapping(5) + np.array([1e-4, 0.0])
    holes = np.zeros(x.shape, bool)
    for name, depth_mm, middle in dents:
        r = np.maximum(np.hypot(x - middle, y), 1e-6)
        true = true + depth_mm * DENTS[name][0](r, RADIUS_MM)
        steep = outwards(DENTS[name][0], depth_mm)(r) / r
        slope += steep[..., None] * np.stack([x - middle, y], axis=-1)
        holes |= r < RADIUS_MM + holes_mm
    read = np.where(holes, np.nan, true + np.random.default_rng(5).normal(0, NOISE_MM, true.shape))
    sigma = np.full(slope.shape, NOISE)
    surface = Surface(
        read, slope, x, y, np.where(holes, np.nan, 3 * NOISE_MM), sigma, ~holes, holes,
        Anchor("none", np.zeros(x.shape, bool), 0.0), 0, 1,
    )  # fmt: skip
    return surface, Places(np.stack([x, y], axis=-1)), true


def carried(surface: Surface, places: Places, contacts: list[Contact]) -> Any:
    reader = ForceReader(rig())
    reader.read(surface, contacts)
    return carried_inside(surface, contacts, places, reader.fit)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", list(DENTS))
@pytest.mark.parametrize("lost_mm", [0.0, 0.6])
def test_a_planted_dent_is_carried_in_within_its_sigma(name: str, lost_mm: float) -> None:
    surface, places, true = pressed((name, 0.02, 0.0), holes_mm=lost_mm)
    inside, (contact,) = carried(surface, places, [round_contact()])
    r = np.hypot(surface.x_mm, surface.y_mm)
    assert (inside.valid == (r < RADIUS_MM + lost_mm)).all()
    z = ((inside.depth_mm - true) / inside.sigma_depth_mm)[inside.valid]
    assert np.abs(z).max() < 3
    # sigma is no excuse: less than linear extrapolation and nothing differ by, and growing inwards
    assert abs(contact.depth_mm - true.max()) < 2 * contact.sigma_depth_mm < 0.02
    rim = inside.valid & (r > RADIUS_MM + lost_mm - 0.3)
    assert np.median(inside.sigma_depth_mm[rim]) < inside.sigma_depth_mm[inside.valid].max() / 2


def test_the_depth_of_a_ball_is_known_where_nodes_are_read_up_to_its_border() -> None:
    surface, places, true = pressed(("ball", 0.02, 0.0))
    inside, (contact,) = carried(surface, places, [round_contact()])
    surface = replace(surface, inside=inside)
    found, measured = deepest_of_all(surface, peak(surface), (contact,)), peak(surface)
    assert found.where is Where.INSIDE
    # a cone or punch of that border would be a third deeper or shallower
    assert abs(found.depth_mm - true.max()) < 1.5 * found.sigma_mm < 0.35 * true.max()
    assert found.depth_mm > 1.5 * measured.depth_mm
    assert contact.depth_mm == found.depth_mm


def test_the_tip_of_a_cone_is_looked_for_between_the_nodes() -> None:
    """Nodes are 0.3 mm apart: the nearest is a seventh of the depth above a tip in between."""
    surface, places, true = pressed(("cone", 0.02, 0.15))
    tip = 0.02 + 1e-4 * 0.15 + 3e-4
    assert true.max() < 0.9 * tip
    _, (contact,) = carried(surface, places, [round_contact(0.15)])
    assert abs(contact.depth_mm - tip) < 2 * contact.sigma_depth_mm < 0.5 * tip


def test_two_contacts_are_distinguished_by_their_common_dent() -> None:
    surface, places, true = pressed(("ball", 0.02, 2.1), ("ball", 0.01, -2.1), holes_mm=0.3)
    contacts = [round_contact(2.1), round_contact(-2.1)]
    _, found = carried(surface, places, contacts)
    for contact in found:
        own = np.hypot(surface.x_mm - contact.x_mm, surface.y_mm) < RADIUS_MM
        assert abs(contact.depth_mm - true[own].max()) < 3 * contact.sigma_depth_mm < true[own].max()


def test_a_peak_beside_a_contact_of_unknown_depth_says_so() -> None:
    surface, _, _ = pressed(("ball", 0.02, 0.0))
    assert deepest_of_all(surface, peak(surface), (round_contact(),)).where is Where.BESIDE
    away = Peak(0.01, 6.0, 6.0, 1e-4)
    assert deepest_of_all(surface, away, (round_contact(),)).where is Where.MEASURED


def test_nothing_is_said_of_a_contact_that_leaves_too_little_to_read() -> None:
    surface, places, _ = pressed(("ball", 0.02, 0.0), holes_mm=16.0)
    contacts = [round_contact(radius_mm=6.0)]
    assert carried(surface, places, contacts) == (None, tuple(contacts))


@pytest.mark.parametrize("sigma_mm", [0.6, 1.0, 2.0, 4.0])
@pytest.mark.parametrize("depth_mm", [0.03, 0.003])
def test_nothing_is_said_of_a_pad_that_presses_around_its_wet_middle_too(
    sigma_mm: float, depth_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No pressure inside the border makes its slopes: the fit said up to -12 mm of 0.03 mm."""
    monkeypatch.setitem(DENTS, "pad", (lambda r, a: np.exp(-(r**2) / (2 * sigma_mm**2)), 1.0))
    surface, places, _ = pressed(("pad", depth_mm, 0.0))
    contacts = [round_contact()]
    assert carried(surface, places, contacts) == (None, tuple(contacts))


def test_a_deep_pad_beside_a_ball_leaves_it_unknown_and_a_shallow_one_does_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(DENTS, "pad", (lambda r, a: np.exp(-(r**2) / 8), 1.0))
    for depth_mm, known in ((0.03, False), (0.003, True)):
        surface, places, _ = pressed(("ball", 0.02, -3.0), ("pad", depth_mm, 5.0))
        hole = np.hypot(surface.x_mm - 5.0, surface.y_mm) < RADIUS_MM
        surface = replace(surface, valid=surface.valid | hole, contact=surface.contact & ~hole)
        inside, (contact,) = carried(surface, places, [round_contact(-3.0)])
        assert (inside is not None) == known
        # 1.5 of its sigma: the pad's slopes add to what is open of the pressure's shape
        assert not known or abs(contact.depth_mm - 0.02) < 1.5 * contact.sigma_depth_mm


def test_nothing_is_beside_a_contact_where_nodes_never_had_light() -> None:
    pressed_at, _, _ = pressed(("ball", 0.02, 0.0))
    deepest = peak(pressed_at)
    finder = ContactFinder.__new__(ContactFinder)
    finder._lit = np.zeros(pressed_at.valid.shape, bool)
    assert finder.carry(pressed_at, deepest, (), None)[1].where is Where.MEASURED
    finder.carry(replace(pressed_at, valid=pressed_at.on_mirror), deepest, (), None)
    assert finder.carry(pressed_at, deepest, (), None)[1].where is Where.BESIDE


@pytest.mark.parametrize("flank_deg", [5.0, 20.0, 45.0])
def test_a_peak_beside_a_hole_says_how_deep_a_tip_in_it_may_go(flank_deg: float) -> None:
    """The hole is several times as wide as what touches; known are its size and how steep it is around."""
    least = np.sqrt(0.2 / np.pi) / RADIUS_MM  # shapes are the same at any size: this one is a quarter of it
    tip_mm = np.pi / 2 * RADIUS_MM * np.tan(np.radians(flank_deg))
    surface, _, true = pressed(("cone", tip_mm, 0.0), holes_mm=2.0)
    lengths = ("depth_mm", "x_mm", "y_mm", "sigma_depth_mm")
    small = replace(surface, **{name: least * getattr(surface, name) for name in lengths})
    found, deepest_mm = deepest_of_all(small, peak(small), ()), least * true.max()
    assert found.where is Where.BESIDE
    assert deepest_mm > 4 * found.depth_mm
    assert abs(deepest_mm - found.depth_mm) < 3 * found.sigma_mm
    # all flanks up to 45 degrees are as likely: at 5 degrees it says 2.4 times what is true
    assert found.sigma_mm < 4 * deepest_mm


def test_what_makes_steeper_slopes_than_a_contact_too_small_to_be_outlined_is_no_tip() -> None:
    surface, _, _ = pressed(("cone", 0.5, 0.0), holes_mm=2.0)
    found = deepest_of_all(surface, peak(surface), ())
    assert found.where is Where.BESIDE
    assert found.sigma_mm == peak(surface).sigma_mm
