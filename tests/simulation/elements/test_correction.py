"""Bodies in elements against closed forms: a layer, a box between sliding walls; and loaded directly."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import j0
from skfem import MeshTri

from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.compliance import Compliance, layer_factor
from zeromethod.simulation.elements import half_space
from zeromethod.simulation.elements.correction import mirror_response
from zeromethod.simulation.elements.elasticity import ElasticBody, line_mesh
from zeromethod.simulation.elements.section import Section, SectionFace, prism_section


def slab(x_mm, w_mm, supports):
    """Rectangle of given lattice lines; supports of its left side, right side and base."""
    mesh = MeshTri.init_tensor(np.asarray(x_mm, float), np.asarray(w_mm, float))
    low, high, deep = float(x_mm[0]), float(x_mm[-1]), float(w_mm[-1])
    left, right, base = supports
    faces = (
        SectionFace((low, 0.0), (low, deep), (-1.0, 0.0), left),
        SectionFace((high, 0.0), (high, deep), (1.0, 0.0), right),
        SectionFace((low, deep), (high, deep), (0.0, 1.0), base),
    )
    return Section(mesh, faces, (low, high))


def body_of(section, half_width_mm, cells, ends, poisson):
    return ElasticBody(section, line_mesh(half_width_mm, cells), ends, 1 / (2 * (1 + poisson)), poisson)


def prism_body(cells, supports=("bonded", "bonded"), ends="free", poisson=0.49):
    angles = np.radians(50.0), np.radians(42.0)
    section = prism_section(70.0, *angles, supports, cells)
    return body_of(section, 30.0, max(2, 2 * cells // 3), ends, poisson)


def test_a_wide_slab_is_a_layer_between_free_sides_and_bonded_ones():
    """Nearly incompressible: elements that lock would be stiffer by far."""
    share, away = np.linspace(-1, 1, 11), np.array([0.0, 4.0, 10.0])
    found = []
    for sides in ("free", "bonded"):
        section = slab(25 * share * np.sqrt(np.abs(share)), np.linspace(0, 10, 4), (sides, sides, "bonded"))
        body = body_of(section, 25.0, 6, sides, 0.4999)
        found.append(mirror_response(body, np.zeros((2, 1)), np.stack((away, np.zeros(3))))[:, 0])
    layer = Compliance(Rubber(support="bonded", thickness_mm=10.0, poisson=0.4999)).of_layer(away)
    assert np.all(found[0] > found[1])
    # sides 25 mm away change it by +- 1.1 %, and by a share of that in the mean; cells of 3 to 5 mm
    np.testing.assert_allclose(np.mean(found, axis=0), layer, atol=0.005 * abs(layer[0]))


def box_response(size_mm, depth_mm, place, force, sigma_mm, poisson):
    """Depth, mm, of a box between sliding walls on a sliding base under 1 N spread with sigma: a series."""
    modulus = 1 / (1 - poisson**2)
    across = [np.cos(np.arange(80) * np.pi * (p / s + 0.5)) for p, s in zip(place, size_mm, strict=True)]
    by = [np.cos(np.arange(80) * np.pi * (f / s + 0.5)) for f, s in zip(force, size_mm, strict=True)]
    waves = [np.arange(80) * np.pi / s for s in size_mm]
    k = np.hypot(waves[0][:, None], waves[1])
    k[0, 0] = 1.0
    yields = (
        2
        / (modulus * k)
        * layer_factor(k * depth_mm, poisson, bonded=False)
        * np.exp(-((k * sigma_mm) ** 2) / 2)
    )
    yields[0, 0] = depth_mm * (1 + poisson) * (1 - 2 * poisson) / (1 - poisson)  # even compression
    twice = np.where(np.arange(80) == 0, 1.0, 2.0)
    weight = np.outer(twice * across[0] * by[0], twice * across[1] * by[1]) / np.prod(size_mm)
    return float((weight * yields).sum())


def half_space_response(distance_mm, sigma_mm, poisson):
    """The same of a half-space."""
    waves = lambda k: j0(k * distance_mm) * np.exp(-((k * sigma_mm) ** 2) / 2)  # noqa: E731
    return (1 - poisson**2) / np.pi * quad(waves, 0, 6 / sigma_mm, limit=200)[0]


def test_a_box_between_sliding_walls_is_its_cosine_series():
    poisson, sigma = 0.45, 1.0
    section = slab(np.linspace(-20, 20, 12), np.linspace(0, 15, 5), ("sliding", "sliding", "sliding"))
    body = body_of(section, 15.0, 4, "sliding", poisson)
    force, places = (-3.0, 5.0), np.array([[-3.0, 6.0, 12.0], [5.0, 0.0, -9.0]])
    found = mirror_response(body, np.array(force)[:, None], places)[:, 0]
    exact = [
        box_response((40.0, 30.0), 15.0, place, force, sigma, poisson)
        - half_space_response(np.hypot(*(place - force)), sigma, poisson)
        for place in places.T
    ]
    # the load of the series is spread with sigma: (sigma / 20 mm)^2; cells of 3 mm
    np.testing.assert_allclose(found, exact, atol=0.01 * np.abs(exact).max())


def test_a_prism_loaded_directly_yields_as_half_space_and_correction_together():
    """The same body under a wide load on its mirror, without any half-space: signs of what is taken off."""
    body, sigma, middle = prism_body(8, ("sliding", "bonded")), 6.0, np.array([34.0, 4.0])
    x, w, y = body.nodes
    pressed = np.zeros((3, len(x), len(y), 2))
    mirror = SectionFace((0.0, 0.0), (70.0, 0.0), (0.0, -1.0), "free")
    for side in (1, -1):
        away = (x[:, None] - middle[0]) ** 2 + (side * y - middle[1]) ** 2
        pressure = np.where(np.abs(w)[:, None] < 1e-9, np.exp(-away / (2 * sigma**2)), 0) / (
            2 * np.pi * sigma**2
        )
        pressed[1] += 0.5 * np.stack((pressure, side * pressure), axis=-1)
    load = body.face_load(mirror, pressed)
    even, odd = (
        body.solve(np.zeros_like(load[..., :1]), load[..., [k]], even=k == 0)[1, ..., 0] for k in range(2)
    )
    nodes = [(int(np.argmin(np.hypot(x - at, w))), int(np.argmin(np.abs(y - off)))) for at, off in
             ((34.0, 4.0), (20.0, 12.0), (50.0, 0.0))]  # fmt: skip
    places = np.array([(x[n], y[m]) for n, m in nodes]).T
    direct = np.array([even[n, m] + odd[n, m] for n, m in nodes])
    # forces of a Gaussian: its middle, and the four points that give its second moments
    forces = middle[:, None] + sigma * np.sqrt(2) * np.array([[0, 1, -1, 0, 0], [0, 0, 0, 1, -1.0]])
    weights = np.array([0.0, 0.25, 0.25, 0.25, 0.25])
    smooth = mirror_response(body, forces, places) @ weights
    space = [half_space_response(np.hypot(*(place - middle)), sigma, 0.49) for place in places.T]
    # moments of the fourth order, (sigma / 25 mm)^4, and cells of 9 mm under the load
    np.testing.assert_allclose(direct, space + smooth, atol=0.02 * max(space))


def test_what_a_half_space_does_to_the_faces_balances_its_force():
    body = prism_body(9)
    x, w, y = body.nodes
    total, turning = np.zeros(3), 0.0
    for side in (1.0, -1.0):
        at = x[:, None] - 30.0, side * y[None, :] - 5.0, w[:, None]
        stress = half_space.stress(*np.broadcast_arrays(*at), body.poisson)[..., None]
        loads = [
            body.face_load(face, np.where(body.on(face)[:, None, None], pulled, 0.0))
            for face in body.section.faces
            for pulled in [(stress[0] * face.normal[0] + stress[2] * face.normal[1])[[0, 2, 1]]]
        ]
        loads.append(body.end_load(side * stress[1][[0, 2, 1]][:, :, body.end]))
        load = sum(loads)[..., 0]
        total += load.sum(axis=(1, 2))
        turning += float((load[1] * x[:, None] - load[0] * w[:, None]).sum())
    # tractions between nodes 5 mm apart, where the force is 20 mm away
    np.testing.assert_allclose(total, [0.0, -1.0, 0.0], atol=5e-3)
    assert turning == pytest.approx(-30.0, abs=0.2)


def test_work_is_mutual():
    body = prism_body(6, ("bonded", "sliding"))
    places = np.array([[30.0, 45.0, 20.0], [0.0, 8.0, -12.0]])
    response = mirror_response(body, places, places)
    np.testing.assert_allclose(response, response.T, atol=0.005 * np.abs(response).max())


def test_a_body_that_nothing_holds_is_refused():
    with pytest.raises(ValueError, match="nothing keeps the body from moving"):
        prism_body(3, ("sliding", "free"))
