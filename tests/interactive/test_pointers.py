"""Contacts as pointer events: ids, order, hysteresis, pressure, cancel; the picture that they drive."""

from dataclasses import replace

import numpy as np
import pytest

from zeromethod import load_rig
from zeromethod.contact import ContactFigures
from zeromethod.interactive.homography import mapped, mm_to_px
from zeromethod.interactive.pointers import Pointers, PointerType
from zeromethod.interactive.screen import PointerScreen
from zeromethod.session.interaction import pointer_rows
from zeromethod.view.table import pointer_words

SPEC = load_rig("interactive").projector
FRAME_NS = 16_666_667
FINGER = ContactFigures(
    id=1, x_mm=40.0, y_mm=2.0, sigma_x_mm=0.05, sigma_y_mm=0.05, area_mm2=10.0, sigma_area_mm2=1.0,
    major_mm=4.0, minor_mm=3.0, angle_deg=0.0, sigma_edge_mm=0.1, scattered=0.3,
    force_n=0.4, sigma_force_n=0.002,
)  # fmt: skip


def _types(events):
    return [(event.type, event.pointer_id) for event in events]


def test_a_finger_comes_moves_and_goes_as_browsers_have_it():
    pointers = Pointers(SPEC)
    (down,) = pointers.follow([FINGER], 0)
    assert down.type is PointerType.DOWN
    assert down.is_primary
    assert down.pressure == pytest.approx(0.4)
    there = mapped(mm_to_px(SPEC), [40.0, 2.0])
    assert (down.x_px, down.y_px) == pytest.approx(tuple(there))
    assert pointers.follow([FINGER], FRAME_NS) == ()  # nothing changed, nothing is said
    (moved,) = pointers.follow([replace(FINGER, x_mm=41.0)], 2 * FRAME_NS)
    assert moved.type is PointerType.MOVE
    # 68 mm are 640 columns
    assert moved.x_px - down.x_px == pytest.approx(640 / 68, rel=0.05)
    assert pointers.follow([], 3 * FRAME_NS, followed={1}) == ()  # not found, and not seen to have left
    (up,) = pointers.follow([], 4 * FRAME_NS)
    assert (up.type, up.pressure, up.pointer_id) == (PointerType.UP, 0.0, 1)
    assert not pointers.down


def test_a_piece_of_a_finger_that_lifts_is_no_move_unless_it_stays():
    pointers = Pointers(SPEC)
    pointers.follow([FINGER], 0)
    piece = replace(FINGER, x_mm=42.6, area_mm2=2.0, force_n=0.1)
    assert pointers.follow([piece], FRAME_NS) == ()
    (moved,) = pointers.follow([piece], 2 * FRAME_NS)
    assert (moved.type, moved.x_mm) == (PointerType.MOVE, 42.6)
    pointers.follow([FINGER], 3 * FRAME_NS)
    assert pointers.follow([piece], 4 * FRAME_NS) == ()
    assert [(one.type, one.x_mm) for one in pointers.follow([], 5 * FRAME_NS)] == [(PointerType.UP, 40.0)]


def test_a_row_of_each_finger_says_how_it_came_and_ended():
    pointers = Pointers(SPEC)
    other = replace(FINGER, id=2, x_mm=60.0)
    said = [*pointers.follow([FINGER], 0), *pointers.follow([replace(FINGER, x_mm=41.0)], FRAME_NS)]
    said += [*pointers.follow([other], 2 * FRAME_NS), *pointers.follow([other], 3 * FRAME_NS)]
    first, second = pointer_rows(said, -FRAME_NS)
    assert (first["id"], first["x_mm"], first["to_x_mm"], first["moves"]) == (1, 40.0, 41.0, 1)
    assert (first["down_s"], first["up_s"]) == pytest.approx((1e-9 * FRAME_NS, 3e-9 * FRAME_NS))
    assert (first["ended"], second["ended"], second["up_s"]) == ("pointerup", None, None)
    cancelled = pointer_rows([*said, *pointers.unread(4 * FRAME_NS, "fault: no camera")], -FRAME_NS)[1]
    (_, up), (_, lost) = pointer_words({"pointers": [first, cancelled]})
    assert "; 1 moves; up at 0.05 s, (41.00 ± 0.05, 2.00 ± 0.05) mm" in up
    assert "cancelled (fault: no camera)" in lost
    assert "still down" in pointer_words({"pointers": [second]})[0][1]
    assert pointer_words({"pointers": []}) == [("pointer events", "none")]


def test_noise_of_place_and_force_is_no_move_but_a_harder_press_is():
    pointers = Pointers(SPEC)
    pointers.follow([FINGER], 0)
    draw = np.random.default_rng(3)
    for k in range(50):
        x, y = (draw.uniform(-0.02, 0.02, 2)).tolist()
        noisy = replace(FINGER, x_mm=40.0 + x, y_mm=2.0 + y, force_n=0.4 + draw.uniform(-0.003, 0.003))
        assert pointers.follow([noisy], k * FRAME_NS) == ()
    (pressed,) = pointers.follow([replace(FINGER, force_n=0.45)], 60 * FRAME_NS)
    assert pressed.pressure == pytest.approx(0.45)


def test_fingers_keep_their_ids_and_only_the_first_is_primary():
    pointers = Pointers(SPEC)
    other = replace(FINGER, id=2, x_mm=60.0)
    assert [event.is_primary for event in pointers.follow([FINGER, other], 0)] == [True, False]
    assert _types(pointers.follow([other], 2 * FRAME_NS)) == [(PointerType.UP, 1)]
    (moved,) = pointers.follow([replace(other, x_mm=61.0)], 3 * FRAME_NS)
    assert not moved.is_primary


def test_a_state_that_knows_nothing_cancels_and_the_finger_says_nothing_until_it_is_lifted():
    pointers = Pointers(SPEC)
    pointers.follow([FINGER], 0)
    (gone,) = pointers.unread(FRAME_NS, "lost: too few nodes")
    assert (gone.type, gone.reason, gone.pressure) == (PointerType.CANCEL, "lost: too few nodes", 0.0)
    assert pointers.follow([FINGER], 2 * FRAME_NS) == ()
    assert pointers.follow([], 3 * FRAME_NS, followed={1}) == ()
    assert pointers.follow([FINGER], 3 * FRAME_NS) == ()  # only not found in between
    assert pointers.follow([], 4 * FRAME_NS) == ()
    assert _types(pointers.follow([FINGER], 5 * FRAME_NS)) == [(PointerType.DOWN, 1)]


def test_steps_without_a_reading_cancel_after_a_quarter_of_a_second():
    pointers = Pointers(SPEC)
    pointers.follow([FINGER], 0)
    assert pointers.unread(200_000_000) == ()
    (gone,) = pointers.unread(260_000_000)
    assert gone.type is PointerType.CANCEL
    assert "0.25 s" in gone.reason


def test_pressure_is_bounded_and_one_half_where_no_force_is_read():
    hard, unknown = (replace(FINGER, id=k, force_n=force) for k, force in ((1, 3.0), (2, float("nan"))))
    assert [event.pressure for event in Pointers(SPEC).follow([hard, unknown], 0)] == [1.0, 0.5]


def test_an_event_has_the_names_of_a_browsers_pointer_event():
    (down,) = Pointers(SPEC).follow([replace(FINGER, force_n=float("nan"))], 5)
    named = down.as_browsers_have_it
    assert {
        "type",
        "pointerId",
        "pointerType",
        "isPrimary",
        "x",
        "y",
        "width",
        "height",
        "pressure",
    } <= named.keys()
    assert named["force_n"] is None
    # 4 mm by 3 mm, 9.4 px a mm along columns and 9.1 along rows
    assert named["width"] == pytest.approx(4 * 640 / 68, rel=0.06)
    assert named["height"] == pytest.approx(3 * 400 / 43.5, rel=0.06)


def test_sigma_in_pixels_has_finger_and_map():
    sharp = SPEC.model_copy(update={"sigma_mm": 0.0})
    (own,) = Pointers(sharp).follow([FINGER], 0)
    (both,) = Pointers(SPEC).follow([FINGER], 0)
    assert own.sigma_px == pytest.approx(0.05 * 9.3, rel=0.1)
    assert both.sigma_px == pytest.approx(1.0 * 9.3, rel=0.1)


def test_the_picture_follows_fingers_and_fades():
    screen, pointers = PointerScreen(SPEC), Pointers(SPEC)
    first = screen.draw((), (), 0)
    assert first is not None
    assert not first.any()
    assert screen.draw((), (), FRAME_NS) is None  # still black
    screen.draw(pointers.follow([FINGER], 2 * FRAME_NS), pointers.down, 2 * FRAME_NS)
    moved = pointers.follow([replace(FINGER, x_mm=45.0)], 3 * FRAME_NS)
    picture = screen.draw(moved, pointers.down, 3 * FRAME_NS)
    x, y = mapped(mm_to_px(SPEC), [42.5, 2.0])
    assert picture[round(y), round(x)] > 200  # half-way between
    pointers.follow([], 4 * FRAME_NS)
    up = pointers.follow([], 5 * FRAME_NS)
    screen.draw(up, pointers.down, 5 * FRAME_NS)
    later = screen.draw((), (), 2_000_000_000)
    assert 100 < later[round(y), round(x)] < 140  # half of it is left after 2 s
    white = PointerScreen(SPEC.model_copy(update={"picture": "white"}))
    assert white.draw((), (), 0).min() == 255
