"""Borders beside steep cones: a planted cone in ideal rubber, seen under a slanted ray."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from zeromethod import load_rig
from zeromethod.contact.likelihood import grey_model
from zeromethod.contact.polygon import radius_of
from zeromethod.contact.region import Region
from zeromethod.contact.shadow import Shadows
from zeromethod.optics import Optics, fresnel

INDEX, RADIUS_MM, MM_PER_PX, MEAN, BLUR_PX = 1.41, 0.6, 0.03, 100.0, 1.0
RAY = np.array([-np.sin(np.radians(55)), 0.0, np.cos(np.radians(55))])
PER_DEPTH = RAY[:2] / RAY[2]
NOISE = 4.0, 0.0


def light_of(flank_deg: float, own: float) -> np.ndarray:
    """(120, 120) light over the mean about a cone, as Sneddon has the rubber and Fresnel the mirror."""
    tangent = np.tan(np.radians(flank_deg))
    v, u = (MM_PER_PX * (axis - 60) for axis in np.mgrid[:120, :120].astype(float))
    x, y = u.copy(), v.copy()
    for _ in range(60):  # where the ray meets the flank, which lies less deep than the border
        rho = np.maximum(np.hypot(x, y) / RADIUS_MM, 1.0)
        drop = RADIUS_MM * tangent * (rho - 1 - np.sqrt(rho**2 - 1) + np.arccos(1 / rho))
        x, y = u + drop * PER_DEPTH[0], v + drop * PER_DEPTH[1]
    rho = np.maximum(np.hypot(x, y) / RADIUS_MM, 1.0)
    slope = tangent * (1 - np.sqrt(rho**2 - 1) / rho) / (RADIUS_MM * rho)
    normal = np.stack([-slope * x, -slope * y, np.ones_like(x)], axis=-1)
    cosine = (normal @ RAY) / np.linalg.norm(normal, axis=-1)
    mirrored = np.mean(fresnel(np.clip(cosine, 0, 1), INDEX, 1.0), axis=0)
    covered = np.hypot(u, v) < RADIUS_MM
    return gaussian_filter(np.where(covered, own, mirrored), BLUR_PX)


def outcome(flank_deg: float, own: float):
    """(border as it looks, what is made of it), px about the middle; the ball's force is what the law has."""
    light = light_of(flank_deg, own)
    draw = np.random.default_rng(2)
    shares = np.ones(8) / 8
    model = grey_model(own * MEAN, MEAN, np.linspace(0.1, 1.9, 8), shares, BLUR_PX, NOISE)
    columns = model.index((MEAN * light + draw.normal(0, 2, light.shape)).astype(np.float32))
    turn = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    way = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    far = np.arange(1.0, 50.0, 0.1)
    at = np.rint(60 + far[:, None, None] * way).astype(int)
    half = far[np.argmax(light[at[..., 1], at[..., 0]] > 0.5, axis=0)]
    looks = half[:, None] * way
    mask = np.zeros(light.shape, bool)
    region = Region(0, 0, mask, mask.astype(np.float32), columns, model, own)
    shadows = Shadows(Optics(load_rig("simulated")), BLUR_PX, NOISE)
    at_1_mm = RADIUS_MM**2 * np.tan(np.radians(flank_deg)) / 2
    slant = np.tile(PER_DEPTH, (len(looks), 1))
    return looks, shadows.without(60 + looks, region, MM_PER_PX * looks, slant, at_1_mm)


@pytest.mark.parametrize(("flank_deg", "own"), [(20.0, 0.06), (20.0, 0.01)])
def test_the_shadow_of_a_steep_cone_is_no_contact(flank_deg, own):
    looks, border = outcome(flank_deg, own)
    true_px = RADIUS_MM / MM_PER_PX
    assert radius_of(looks) > 1.03 * true_px  # the shadow is there
    off = np.hypot(*(border.points_px - 60).T) - true_px
    # 20 um of this bench's 30 um pixels
    assert np.sqrt(np.mean(off**2)) < 0.67
    assert abs(radius_of(border.points_px) / true_px - 1) < 0.01  # 2 % of the area
    assert border.sigma_px > 0


@pytest.mark.parametrize(("flank_deg", "own"), [(3.0, 0.06), (20.0, 0.3)])
def test_flat_flanks_and_bright_objects_have_none(flank_deg, own):
    assert outcome(flank_deg, own)[1] is None
