"""What objects do to the mirror at one instant: its depth as maps, and what lies in front of it as gaps.

Depth is kept as two maps an object: a wide one of `WIDE_PITCH_MM`, and a fine one around the contact that
adds what the wide one lacks there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.fft import irfft2, next_fast_len, rfft2
from scipy.ndimage import spline_filter

from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.rig.prism_tables import Prism
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.compliance import Compliance, LatticeResponse
from zeromethod.simulation.contact.objects import Held
from zeromethod.simulation.contact.patch import Patch, Presser
from zeromethod.simulation.contact.touch import Touch, touch_of
from zeromethod.simulation.press import Dent, Shape
from zeromethod.simulation.spline import MARGIN

WIDE_PITCH_MM = 0.25
WIDE_MM = (90.0, 70.0)
"""How far the wide map reaches from its object along x and y."""
FINE_MM = 1.5
"""How far the fine map reaches from the contact's border, at most; three times the contact's half size if
that is less."""
_ROUNDS = 3
"""Times that the objects of a scene are solved, each beside the last pressures of the others."""
_KEPT = 24


@dataclass(frozen=True)
class Scene:
    """dents: the mirror's depth. touches: what lies against it, one for each object in contact."""

    dents: tuple[Dent, ...] = ()
    touches: tuple[Touch, ...] = ()


def scene_of(held: Sequence[Held], rubber: Rubber, prism: Prism | None = None) -> Scene:
    """Contact of objects held at one instant; the newest are kept, wherever on the mirror they are.

    prism: the rig's; it matters where the rubber's support is given per face, and then so does the place.
    Raises InputError where objects run into each other, or a depth is without sense.
    """
    if not held:
        return Scene()
    compliance = Compliance(rubber, prism)
    if compliance.body is not None:
        return _solved(tuple(held), compliance)
    x0, y0 = held[0].x_mm, held[0].y_mm
    # moved together, the objects do the same to the rubber
    alike = tuple(replace(h, x_mm=round(h.x_mm - x0, 9), y_mm=round(h.y_mm - y0, 9)) for h in held)
    found = _solved(alike, Compliance(rubber))
    dents = tuple(replace(dent, x_mm=dent.x_mm + x0, y_mm=dent.y_mm + y0) for dent in found.dents)
    return Scene(dents, tuple(touch.moved(x0, y0) for touch in found.touches))


@lru_cache(_KEPT)
def _solved(held: tuple[Held, ...], compliance: Compliance) -> Scene:
    pressers = [Presser(each, compliance) for each in held]
    patches: list[Patch] = []
    for presser in pressers:
        patches.append(presser.patch(patches))
    for _ in range(_ROUNDS - 1 if len(held) > 1 else 0):
        for k, presser in enumerate(pressers):
            patches[k] = presser.patch(patches[:k] + patches[k + 1 :])
    _check_apart(patches)
    dents: list[Dent] = []
    for patch in patches:
        if patch.touching.any():
            dents += _depth_maps(patch, compliance)
    return Scene(tuple(dents), tuple(touch_of(p) for p in patches if p.touching.any()))


def _check_apart(patches: list[Patch]) -> None:
    """Refuse objects whose contacts lie on each other."""
    for k, patch in enumerate(patches):
        x, y, _ = patch.loads()
        for other in patches[:k]:
            along, across = other.held.local(x, y)
            col = np.rint(along / other.lattice.pitch_mm + (other.lattice.cols - 1) / 2).astype(int)
            row = np.rint(across / other.lattice.pitch_mm + (other.lattice.rows - 1) / 2).astype(int)
            inside = (col >= 0) & (col < other.lattice.cols) & (row >= 0) & (row < other.lattice.rows)
            if other.touching[row[inside], col[inside]].any():
                raise InputError(
                    f"object[{patch.held.number}]: its contact lies on that of object[{other.held.number}]: "
                    "objects whose contacts lie apart"
                )


def _depth_maps(patch: Patch, compliance: Compliance) -> tuple[Dent, ...]:
    """Dents, wide and fine ones, that add up to what the patch's pressures do to the surface."""
    depth = _wide_depth(patch, compliance)
    wide = _wide_map(patch, depth)
    lattice, held = patch.lattice, patch.held
    along, across = lattice.mesh()
    half = min(np.abs(along[patch.touching]).max(), np.abs(across[patch.touching]).max())
    margin = int(np.ceil(min(FINE_MM, 3 * half) / lattice.pitch_mm))
    spread = LatticeResponse(compliance, (lattice.rows, lattice.cols), lattice.pitch_mm, margin)
    near = spread.displacement(patch.pressed.pressure_mpa)
    rows, cols = near.shape
    at_along = lattice.pitch_mm * (np.arange(cols) - (cols - 1) / 2)
    at_across = lattice.pitch_mm * (np.arange(rows) - (rows - 1) / 2)
    x, y = held.world(*np.meshgrid(at_along, at_across))
    fade = np.outer(_fade(rows, margin), _fade(cols, margin))
    lacks = fade * (near - wide.field(x, y)[0])
    coefficients = spline_filter(np.pad(lacks, MARGIN), order=3, mode="mirror")
    fine = Dent(
        Shape.MAP, held.x_mm, held.y_mm, 1.0, lattice.pitch_mm,
        angle_deg=held.solid.angle_deg, map=lacks, map_coefficients=coefficients,
    )  # fmt: skip
    if compliance.body is not None:
        wide = _wide_map(patch, depth + _of_body(patch, compliance))
    if held.solid.friction:
        return wide, fine, _wide_map(patch, _dragged(patch, compliance))
    return wide, fine


def _dragged(patch: Patch, compliance: Compliance) -> Float:
    """Depth on the wide lattice by friction: deeper ahead, along x, and less deep behind; 0 at nu = 0.5.

    That of a half-space; pressures are taken as without it (Goodman). Source: Johnson 1985, 3.2.
    """
    rubber, held = compliance.rubber, patch.held
    per_n = (1 - 2 * rubber.poisson) * (1 + rubber.poisson) / (2 * np.pi * compliance.youngs_modulus_mpa)
    x, y = (
        middle + WIDE_PITCH_MM * (np.arange(n) - (n - 1) / 2)
        for middle, n in zip((held.x_mm, held.y_mm), _wide_shape(), strict=True)
    )
    depth = np.zeros((len(y), len(x)))
    for bx, by, force in zip(*patch.blocks(), strict=True):
        ahead, across = x - bx, (y - by)[:, None]
        depth += held.solid.friction * force * per_n * ahead / (ahead**2 + across**2 + WIDE_PITCH_MM**2 / 4)
    return depth


def _fade(count: int, margin: int) -> Float:
    """(count,) 1 in the middle, 0 at both ends, smooth within a third of the margin."""
    width = max(margin // 3, 2)
    ramp = np.clip(np.minimum(np.arange(count), np.arange(count)[::-1]) / width, 0, 1)
    return np.asarray(ramp**3 * (10 - 15 * ramp + 6 * ramp**2))


def _wide_shape() -> tuple[int, int]:
    """(cols, rows) of the wide map."""
    along, across = (2 * round(reach / WIDE_PITCH_MM) + 1 for reach in WIDE_MM)
    return along, across


def _wide_map(patch: Patch, depth: Float) -> Dent:
    """Depth on the wide lattice about the object as a dent."""
    held = patch.held
    coefficients = spline_filter(depth, order=3, mode="mirror")
    return Dent(Shape.MAP, held.x_mm, held.y_mm, 1.0, WIDE_PITCH_MM, map=depth, map_coefficients=coefficients)


def _of_body(patch: Patch, compliance: Compliance) -> Float:
    """What the prism adds, on the wide lattice; beyond the mirror as at its border."""
    body, held = compliance.body, patch.held
    assert body is not None
    x, y = (
        np.asarray(middle + WIDE_PITCH_MM * (np.arange(n) - (n - 1) / 2), dtype=np.float64)
        for middle, n in zip((held.x_mm, held.y_mm), _wide_shape(), strict=True)
    )
    return body.on_grid(body.of_forces(*patch.loads()), x, y) / compliance.youngs_modulus_mpa


def _wide_depth(patch: Patch, compliance: Compliance) -> Float:
    """Depth on a lattice along x and y about the object, exact some pitches away from the contact.

    That of a half-space or layer, what a prism adds left out.
    """
    x, y, force = patch.loads()
    held = patch.held
    cols, rows = _wide_shape()
    forces = np.zeros((rows, cols))
    u = (x - held.x_mm) / WIDE_PITCH_MM + (cols - 1) / 2
    v = (y - held.y_mm) / WIDE_PITCH_MM + (rows - 1) / 2
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    if min(i.min(), j.min()) < 1 or i.max() > cols - 3 or j.max() > rows - 3:
        raise InputError(f"object: its contact is larger than {2 * WIDE_MM[0]:g} x {2 * WIDE_MM[1]:g} mm")
    # shared among 4 x 4 points so that forces and their moments up to the third stay
    by_u, by_v = _lagrange(u - i), _lagrange(v - j)
    for b in range(4):
        for a in range(4):
            np.add.at(forces, (j + b - 1, i + a - 1), force * by_u[a] * by_v[b])
    return _of_forces(forces, compliance)


def _lagrange(t: Float) -> tuple[Float, ...]:
    """Weights of the four points at -1, 0, 1, 2 for a place t between 0 and 1."""
    return (
        -t * (t - 1) * (t - 2) / 6,
        (t + 1) * (t - 1) * (t - 2) / 2,
        -(t + 1) * t * (t - 2) / 2,
        (t + 1) * t * (t - 1) / 6,
    )


def _of_forces(forces: Float, compliance: Compliance) -> Float:
    """Displacement of a lattice under forces (N) at its points; each point's own is that of its cell."""
    used = np.nonzero(forces)
    low = [int(index.min()) for index in used]
    high = [int(index.max()) + 1 for index in used]
    inner = forces[low[0] : high[0], low[1] : high[1]]
    sizes = [next_fast_len(n + k - 1, real=True) for n, k in zip(forces.shape, inner.shape, strict=True)]
    reach = [
        WIDE_PITCH_MM * (np.arange(n + k - 1) - (b - 1))
        for n, k, b in zip(forces.shape, inner.shape, high, strict=True)
    ]
    away = np.hypot(reach[1][None, :], reach[0][:, None])
    kernel = compliance.of_force(np.maximum(away, 1e-9))
    here = compliance.of_cells(np.zeros((1, 1)), np.zeros((1, 1)), WIDE_PITCH_MM)[0, 0]
    kernel[away == 0] = here / WIDE_PITCH_MM**2
    whole = irfft2(rfft2(inner, sizes) * rfft2(kernel, sizes), sizes)
    first = [k - 1 for k in inner.shape]
    rows, cols = forces.shape
    return np.asarray(whole[first[0] : first[0] + rows, first[1] : first[1] + cols])
