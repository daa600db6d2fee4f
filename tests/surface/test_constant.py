"""The constant of depth of what rubber makes, by rig files that say what the rubber is and that do not."""

from dataclasses import replace

import numpy as np
import pytest
from surface_bench import Gauss

from benchmarks.anchors import View, anchored
from benchmarks.rigs import coarser
from zeromethod.rig.load import load_rig
from zeromethod.rig.model import KnownRest, SurfaceSpec
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.loads import load, ring
from zeromethod.simulation.press import Mirror
from zeromethod.surface import SurfaceReader, kept_constant
from zeromethod.worker import completed, in_thread

LAG_FRAMES = 12
"""Readings until what was learned from one serves: 0.2 s at 60 Hz."""

FREE = Rubber(support="free")
LAYER = Rubber(support="bonded", thickness_mm=12.0, thickness_sigma_mm=0.5)
SILENT, NOT_ELASTIC = Rubber(), Rubber(body="none")

REST = Mirror()
ONE = Mirror((load(40.0, 3.0, 0.1, 4.0),))
SEVERAL = Mirror((load(30.0, -5.0, 0.08, 3.5), load(50.0, 8.0, 0.05, 5.0), load(55.0, -8.0, 0.1, 6.0)))
RING = Mirror((ring(44.0, -2.0, 0.08, 5.0, 2.5),))
BORDER = Mirror((load(42.0, 19.0, 0.1, 5.0),))
BESIDE = Mirror((load(78.0, -5.0, 0.2, 6.0),))
ON_LAYER = Mirror((load(40.0, 3.0, 0.1, 4.0, LAYER),))
SEVERAL_ON_LAYER = Mirror((load(30.0, -5.0, 0.08, 3.5, LAYER), load(50.0, 8.0, 0.05, 5.0, LAYER)))


@pytest.fixture(scope="module")
def view():
    """The packaged bench with pixels four times as large, of camera and LCD."""
    return View(coarser(load_rig("simulated"), 4))


@pytest.fixture(scope="module")
def reader_by(view):
    """Readers by what the rig file says of the rubber; they keep the fields of loads."""
    made = {}

    def reader(rubber):
        if rubber not in made:
            made[rubber] = view.reader_by(rubber)
        return made[rubber]

    return reader


@pytest.mark.parametrize(
    ("rubber", "dent", "most_mm"),
    [
        # half as much again as it was on this view, in nm: 19 to 26 at rest, 140, 495, 130 to 190, 860; on
        # layers, whose dents end, 59 and 84
        pytest.param(FREE, REST, 5e-5, id="half-space at rest"),
        pytest.param(FREE, ONE, 3e-4, id="one load"),
        pytest.param(FREE, SEVERAL, 8e-4, id="several loads"),
        pytest.param(FREE, RING, 8e-4, id="a ring"),
        pytest.param(FREE, BORDER, 4e-4, id="a load at the border"),
        pytest.param(FREE, BESIDE, 1.3e-3, id="a load outside the view"),
        pytest.param(LAYER, ON_LAYER, 1.2e-4, id="a load on a layer"),
        pytest.param(LAYER, SEVERAL_ON_LAYER, 1.5e-4, id="several loads on a layer"),
        # two bodies may both be: 1.3 to 2.2 um, 3.4, 2.3, 1.3
        pytest.param(SILENT, REST, 5e-5, id="not stated, at rest"),
        pytest.param(SILENT, ONE, 4e-3, id="not stated, one load"),
        pytest.param(SILENT, SEVERAL, 6e-3, id="not stated, several loads"),
        pytest.param(SILENT, BESIDE, 2e-2, id="not stated, a load outside the view"),
        pytest.param(SILENT, SEVERAL_ON_LAYER, 2e-3, id="not stated, several loads on a layer"),
    ],
)
def test_it_is_known_within_its_sigma(view, reader_by, rubber, dent, most_mm):
    reader = reader_by(rubber)
    surface = reader.read(view.warp(dent, np.random.default_rng(1)))
    off_mm, sigma_mm = anchored(view, reader, surface, dent)
    assert surface.anchor.mode == "loads"
    assert abs(off_mm) < 3 * sigma_mm
    assert sigma_mm < most_mm


def test_what_presses_outside_the_view_is_named_and_nothing_where_all_is_in_view(view, reader_by):
    reader = reader_by(FREE)
    outside = reader.read(view.warp(BESIDE, np.random.default_rng(2))).anchor.outside
    assert outside is not None
    # within a width of its middle
    assert np.hypot(outside.x_mm - 78.0, outside.y_mm + 5.0) < 6.0
    # 0.2 mm x 6 mm sqrt(2 / pi)
    assert outside.q_mm2 == pytest.approx(0.2 * 6.0 * np.sqrt(2 / np.pi), abs=4 * outside.sigma_q_mm2)
    assert reader.read(view.warp(ONE, np.random.default_rng(2))).anchor.outside is None


@pytest.mark.parametrize("dent", [REST, ONE, SEVERAL, BORDER, BESIDE], ids=range(5))
def test_what_is_not_elastic_has_an_open_constant_and_says_so(view, reader_by, dent):
    reader = reader_by(NOT_ELASTIC)
    surface = reader.read(view.warp(dent, np.random.default_rng(1)))
    off_mm, sigma_mm = anchored(view, reader, surface, dent)
    # its border is taken for at rest, which is 20 to 80 um deep in these
    assert abs(off_mm) < 3 * sigma_mm
    assert sigma_mm > 1e-3
    assert reader.learned is None


@pytest.mark.parametrize("rubber", [FREE, NOT_ELASTIC], ids=["elastic", "not elastic"])
def test_a_declared_rest_gives_it_exactly(view, rubber):
    rest = SurfaceSpec(known_rest=(KnownRest(x_mm=(66.0, 77.0), y_mm=(-30.0, 30.0)),))
    rig = view.rig.model_copy(update={"rubber": rubber, "surface": rest})
    reader = SurfaceReader(rig, view.optics, view.grid)
    dent = Gauss(0.1, 38.0, 0.0, 4.0)
    surface = reader.read(view.warp(dent))
    off_mm, _ = anchored(view, reader, surface, dent)
    assert surface.anchor.mode == "known"
    # the dent is 0.1 mm x exp(-24) deep there; four-node dents leave the rule 1e-4 of themselves, and of
    # that the mean over the view
    assert abs(off_mm) < 2e-6
    assert surface.anchor.sigma_mm < 2e-6


def test_loads_learned_by_one_reader_give_another_the_same_depth(view):
    warp = view.warp(ONE, np.random.default_rng(4))
    # both new: what was read before may weight noise otherwise
    reader = view.reader_by(FREE)
    surface = reader.read(warp)
    other = SurfaceReader(view.rig, view.optics, view.grid, with_sigma=False)
    found = other.read(warp, learned=reader.learned)
    # settled within 0.1 nm
    np.testing.assert_allclose(found.depth_mm, surface.depth_mm, atol=1e-6)


@pytest.fixture
def frames(view):
    """Warps of dents at 60 Hz, with fresh noise in each."""

    def made(dents, seed=1):
        draw = np.random.default_rng(seed)
        return [
            replace(view.warp(dent, draw), time_ns=round(k * 1e9 / 60))
            for k, dent in enumerate(dents, start=1)
        ]

    return made


def test_loads_learned_from_a_dent_serve_it_a_millimetre_on(view, frames):
    moved = [Mirror((load(40.0 + dx, 3.0 - 0.5 * dx, 0.1, 4.0),)) for dx in (0.0, 0.5, 1.0)]
    reader = view.reader_by(FREE)
    for dent, warp in zip(moved, frames(moved), strict=True):
        surface = reader.follow(warp)
        off_mm, sigma_mm = anchored(view, reader, surface, dent)
        assert abs(off_mm) < 3 * sigma_mm
        # as where it was learned, though chi2 may be larger
        assert sigma_mm < 4e-4
        assert surface.anchor.learned_ns == frames(moved)[0].time_ns


OTHER = Mirror((load(52.0, -6.0, 0.1, 5.0),))


def test_a_sudden_other_press_is_unsure_until_it_is_learned_twelve_readings_later(view, frames):
    dents = [ONE] + [OTHER] * (LAG_FRAMES + 3)
    warps, reader, reads = frames(dents), view.reader_by(FREE), []
    for dent, warp in zip(dents, warps, strict=True):
        surface = reader.follow(warp)
        reads.append((*anchored(view, reader, surface, dent), surface.anchor.learned_ns))
    off_mm, sigma_mm, learned_ns = np.array(reads).T
    assert (np.abs(off_mm) < 3.5 * sigma_mm).all()  # of 16, of which 12 have noise of their own
    first = 1 + LAG_FRAMES
    # by what was learned of the press before, as far as chi2 says
    assert (sigma_mm[1:first] > 1e-3).all()
    assert (sigma_mm[first:] < 5e-4).all()
    assert (learned_ns[first:] == warps[1].time_ns).all()


class Late:
    """A thread that learns when it is waited for."""

    def __init__(self, _name, learn):
        self.result = learn


def at_once(_name, learn):
    """One that learns before anything else."""
    return completed(learn)


def same(one, other):
    for field in ("depth_mm", "sigma_depth_mm", "slope", "valid", "x_mm"):
        np.testing.assert_array_equal(getattr(one, field), getattr(other, field))
    assert one.anchor.sigma_mm == other.anchor.sigma_mm
    assert one.anchor.learned_ns == other.anchor.learned_ns


@pytest.mark.parametrize(
    "threads", [(in_thread, in_thread), (at_once, Late)], ids=["threads", "when it learns"]
)
def test_the_same_warps_in_the_same_order_give_the_same_surfaces_bit_for_bit(
    view, frames, threads, monkeypatch
):
    read = []
    for thread in threads:
        monkeypatch.setattr(kept_constant, "in_thread", thread)
        reader = view.reader_by(FREE)
        read.append([reader.follow(warp) for warp in frames([REST, REST, *[ONE] * 14, *[OTHER] * 16])])
    for one, other in zip(*read, strict=True):
        same(one, other)
    # over several learnings
    assert len({surface.anchor.learned_ns for surface in read[0]}) > 2


@pytest.mark.parametrize("at_rest", [2, 7])
def test_a_press_that_comes_while_noise_is_learned_does_not_wait_for_that(view, frames, at_rest):
    dents = [REST] * at_rest + [ONE] * (LAG_FRAMES + 2)
    reader = view.reader_by(FREE)
    for warp in frames(dents):
        surface = reader.follow(warp)
    off_mm, sigma_mm = anchored(view, reader, surface, ONE)
    assert abs(off_mm) < 3 * sigma_mm
    assert sigma_mm < 3e-4
