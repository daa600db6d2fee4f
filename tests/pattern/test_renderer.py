"""The drawn picture against a numpy picture: every LCD pixel inverts the warp on its own."""

import numpy as np
import pytest

from zeromethod.pattern import PatternRenderer, Response, Target
from zeromethod.warp.grid import NodeGrid
from zeromethod.warp.interpolant import sample, window_matched

GRID = NodeGrid((256, 320))
U, V = GRID.mesh()
SIZE = (420, 330)
ROW, COL = np.indices((SIZE[1], SIZE[0]), dtype=float)
RESPONSE = Response(2.2)
TARGET = Target()
MEAN = RESPONSE.code(0.5)


def _rest(u=U, v=V):
    return np.stack([50 + 0.9 * u + 0.04 * v + 1e-4 * u * v, 30 + 0.95 * v - 0.02 * u], axis=-1)


def _dent(q, height_px, sigma_px=32.0):
    bump = height_px * np.exp(-((U - 160) ** 2 + (V - 128) ** 2) / (2 * sigma_px**2))
    return q + bump[..., None] * np.array([1.0, 0.7])


def _keys(q, u, v):
    return sample(q, (u - GRID.u_px[0]) / GRID.spacing_px, (v - GRID.v_px[0]) / GRID.spacing_px)


def _matched(q):
    """Nodes whose interpolant is drawn, with q in the mean over a window; as exact as the shader has them."""
    matched = np.empty(q.shape, np.float32)
    window_matched(q, matched)
    return matched.astype(float)


def _invert(q):
    """(u, v) of every LCD pixel by damped Newton on the interpolant that is drawn, NaN where none; LCD px per
    period."""
    q = _matched(q)
    centre = q[q.shape[0] // 2, q.shape[1] // 2]
    u, v = 160 + (COL - centre[0]) / 0.9, 128 + (ROW - centre[1]) / 0.95
    u, v = np.clip(u, U[0, 2], U[0, -3]), np.clip(v, V[2, 0], V[-3, 0])
    h = 1e-4
    for _ in range(60):
        miss = np.stack([COL, ROW], axis=-1) - _keys(q, u, v)
        du = (_keys(q, u + h, v) - _keys(q, u - h, v)) / (2 * h)
        dv = (_keys(q, u, v + h) - _keys(q, u, v - h)) / (2 * h)
        det = du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]
        u = u + np.clip((dv[..., 1] * miss[..., 0] - dv[..., 0] * miss[..., 1]) / det, -6, 6)
        v = v + np.clip((du[..., 0] * miss[..., 1] - du[..., 1] * miss[..., 0]) / det, -6, 6)
    found = np.hypot(miss[..., 0], miss[..., 1]) < 1e-7
    longest = np.maximum(np.hypot(du[..., 0], du[..., 1]), np.hypot(dv[..., 0], dv[..., 1]))
    period = TARGET.period_px * np.abs(det) / longest
    return np.where(found, u, np.nan), np.where(found, v, np.nan), period


def _codes(light):
    return np.floor(RESPONSE.inverse(light) + 0.5)


def _image(ctx, q, q_rest=None, target=TARGET):
    """Picture of warp q, drawn by a renderer whose warp at rest is `q_rest` (q itself where not given)."""
    return PatternRenderer(ctx, GRID, q if q_rest is None else q_rest, SIZE, target, RESPONSE).image(q)


@pytest.mark.parametrize("kind", ["cosines", "checker", "lattice", "noise"])
def test_identity_warp_shows_the_target_bit_for_bit(gl_context, kind):
    target = Target(kind)
    q = np.stack([U + 40, V + 30], axis=-1)
    picture = _image(gl_context, q, target=target).astype(float)
    u, v = COL - 40, ROW - 30
    inside = (u > U[0, 1]) & (u < U[0, -2]) & (v > V[1, 0]) & (v < V[-2, 0])
    error = np.abs(picture - _codes(target.light(u, v, lcd_px=(16, 16))))[inside]
    assert (error == 0).mean() > 0.999
    assert error.max() <= 1
    outside = (u < U[0, 1] - 1) | (u > U[0, -2] + 1) | (v < V[1, 0] - 1) | (v > V[-2, 0] + 1)
    assert outside.sum() > 1000
    assert np.array_equal(np.unique(picture[outside]), [MEAN])


def test_dent_is_drawn_within_two_thousandths_of_a_camera_px(gl_context):
    q = _dent(_rest(), 40.0)
    picture = _image(gl_context, q, _rest())
    u, v, period = _invert(q)
    clear = np.isfinite(u) & (period > 6.1)
    assert clear.sum() > 60000
    light = TARGET.light(u, v)
    # Half a code is rounding; what exceeds it, over the codes per camera px, is displacement.
    h = 1e-3
    steepness = np.hypot(
        RESPONSE.inverse(TARGET.light(u + h, v)) - RESPONSE.inverse(light),
        RESPONSE.inverse(TARGET.light(u, v + h)) - RESPONSE.inverse(light),
    )
    excess = (np.abs(picture - RESPONSE.inverse(light)) - 0.5)[clear] / (steepness[clear] / h)
    assert excess[steepness[clear] / h > 5].max() < 0.002
    assert np.abs(picture - RESPONSE.inverse(light))[clear].max() < 0.52


def test_mirrored_lcd_is_drawn_all_the_same(gl_context):
    q = _rest()
    q[..., 0] = SIZE[0] - 1 - q[..., 0]
    picture = _image(gl_context, q)
    straight = _image(gl_context, _rest())
    # sums in 32 bits and pixels on the mesh's rim differ by one code at most
    assert (picture[:, ::-1] == straight).mean() > 0.99


def test_what_is_folded_stays_grey_and_spares_the_rest(gl_context):
    folded = _rest()
    folded[:, 20:24] = folded[:, 24:19:-1][:, :4]  # four columns turned round
    whole = _image(gl_context, _rest())
    picture = _image(gl_context, folded, _rest())
    turned = _rest()
    turned[..., 0] = 400 - turned[..., 0]
    assert np.array_equal(np.unique(_image(gl_context, turned, _rest())), [MEAN])
    far = _rest()[0, 16, 0] > COL
    assert np.array_equal(picture[far], whole[far])


def test_carriers_fade_where_they_would_alias(gl_context):
    for lcd_px, share in ((8.0, 1.0), (5.0, 0.5), (3.8, 0.0)):
        q = np.stack([60 + lcd_px / 16 * U, 40 + 0.8 * V], axis=-1)
        picture = _image(gl_context, q)
        v = (ROW - 40) / 0.8
        u = (COL - 60) / (lcd_px / 16)
        inside = (u > 0) & (u < 320) & (v > 0) & (v < 250)
        wave = 0.225 * (share * np.cos(2 * np.pi * u / 16) + np.cos(2 * np.pi * v / 16))
        np.testing.assert_allclose(picture[inside], RESPONSE.inverse(0.5 + wave)[inside], atol=0.53)


def test_nodes_without_a_warp_leave_their_cells_grey(gl_context):
    q = _rest()
    q[20, 15] = np.nan
    picture = _image(gl_context, q, _rest())
    whole = _image(gl_context, _rest())
    differs = picture != whole
    assert np.array_equal(np.unique(picture[differs]), [MEAN])
    at = _rest()[20, 15]
    distance = np.maximum(np.abs(COL - at[0]), np.abs(ROW - at[1]))
    assert distance[differs].max() < 18  # two cells of 8 camera px around
    assert np.array_equal(np.unique(picture[distance < 7]), [MEAN])
    nothing = np.full_like(q, np.nan)
    assert np.array_equal(np.unique(_image(gl_context, nothing, _rest())), [MEAN])


def test_first_row_of_the_picture_is_the_top_of_the_framebuffer(gl_context):
    q = _rest()
    renderer = PatternRenderer(gl_context, GRID, q, SIZE, TARGET, RESPONSE)
    framebuffer = gl_context.framebuffer([gl_context.texture(SIZE, 4)])
    renderer.render(framebuffer, q)
    pixels = np.frombuffer(framebuffer.read(components=3, alignment=1), np.uint8).reshape(SIZE[1], SIZE[0], 3)
    assert np.array_equal(pixels[::-1, :, 0], renderer.image(q))
    assert np.array_equal(pixels[..., 0], pixels[..., 2])


def test_a_response_that_differs_over_the_panel_is_undone_place_by_place(gl_context):
    exponent = ((0.8, 1.0, 1.1), (1.0, 1.1, 1.25))
    regional = Response(2.2, exponent=exponent)
    q = np.stack([U + 40, V + 30], axis=-1)
    picture = PatternRenderer(gl_context, GRID, q, SIZE, TARGET, regional).image(q)
    u, v = COL - 40, ROW - 30
    inside = (u > U[0, 1]) & (u < U[0, -2]) & (v > V[1, 0]) & (v < V[-2, 0])
    wanted = regional.picture(np.where(inside, TARGET.light(u, v, lcd_px=(16, 16)), 0.5))
    error = np.abs(picture.astype(float) - wanted)[inside]
    # single precision rounds a few codes the other way
    assert (error == 0).mean() > 0.99
    assert error.max() <= 1
    plain = _image(gl_context, q).astype(float)
    assert np.abs(picture - plain)[inside].max() > 5


def test_a_lamp_is_white_around_its_nodes_and_changes_nothing_beyond_them(gl_context):
    renderer = PatternRenderer(gl_context, GRID, _rest(), SIZE, TARGET, RESPONSE)
    q = _dent(_rest(), 6.0)
    away = np.hypot(U - 160, V - 128)
    lit, dark = renderer.image(q, lamp=away < 40).astype(int), renderer.image(q).astype(int)
    u, v, _ = _invert(q)
    where = np.hypot(u - 160, v - 128)
    spacing = GRID.spacing_px
    with np.errstate(invalid="ignore"):
        inside, beyond = where < 40 - 2 * spacing, ~(where < 40 + 2 * spacing)
    assert (lit[inside] == RESPONSE.code(TARGET.mean * (1 + TARGET.contrast))).all()
    assert (lit[beyond] == dark[beyond]).all()
    # asked for again without one, the picture is as before
    assert (renderer.image(q) == dark).all()
    assert (renderer.image(q, lamp=np.zeros(U.shape, bool)) == dark).all()


@pytest.mark.parametrize("kind", ["cosines", "checker", "lattice"])
def test_a_shift_shows_the_target_that_lies_so_many_periods_further(gl_context, kind):
    target, shift = Target(kind), (5 / 16, 1.4)
    q = np.stack([U + 40, V + 30], axis=-1)
    renderer = PatternRenderer(gl_context, GRID, q, SIZE, target, RESPONSE)
    picture, still = renderer.image(q, shift=shift).astype(float), renderer.image(q)
    u, v = COL - 40, ROW - 30
    inside = (u > U[0, 1]) & (u < U[0, -2]) & (v > V[1, 0]) & (v < V[-2, 0])
    wanted = target.light(u + shift[0] * target.period_px, v + shift[1] * target.period_px, lcd_px=(16, 16))
    error = np.abs(picture - _codes(wanted))[inside]
    assert (error == 0).mean() > 0.999
    assert error.max() <= 1
    assert np.array_equal(renderer.image(q), still)
    assert not np.array_equal(picture, still)
