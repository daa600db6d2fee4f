"""Advice from figures alone: thresholds, order, and words that name what to turn."""

from dataclasses import replace

import numpy as np
import pytest

from zeromethod.commissioning.advice import advice, placed
from zeromethod.commissioning.focus import FocusReport
from zeromethod.commissioning.orientation import Alignment, Orientation
from zeromethod.rig.load import load_rig

RIG = load_rig("simulated")
PLACE = Alignment(wider=0.0, higher=0.0, turn_deg=0.0, right_px=0.0, down_px=0.0)
UPRIGHT = Orientation(1.0, stray_grey=0.0, stray_share=0.0, turn_deg=0.0, place=PLACE)
FINE = FocusReport(
    score=0.95,
    on_target=0.95,
    blur_px=0.8,
    modulation=np.full((3, 3), 0.95),
    histogram=np.full(32, 1 / 32),
    mean_grey=100.0,
    bright_grey=200.0,
    full_grey=255.0,
    saturated_share=0.0,
    dark_share=0.0,
    usable_share=1.0,
    seen_share=1.0,
    alignment=PLACE,
)


def test_the_exposure_is_named_that_would_do_where_the_frame_has_room_for_it():
    # (64 - 4) of (255 - 4) grey levels at 4 ms; 0.88 of full scale wants 4 ms x 0.88 x 251 / 60 = 14.7 ms
    rig = RIG.model_copy(update={"camera": RIG.camera.model_copy(update={"exposure_s": 0.004})})
    dim = replace(FINE, bright_grey=64.0, mean_grey=34.0)
    assert advice(dim, rig) == ("too dark: raise the exposure from 4 to about 15 ms",)
    # from 8 ms it would be 29 ms, of 16.7 ms that a frame lasts
    assert advice(dim, RIG)[0].startswith(
        "too dark: 29 ms would be wanted, a frame lasts 16.7 ms: set the LCD"
    )


def test_focus_that_differs_over_the_view_is_a_tilt():
    modulation = FINE.modulation - 0.1 * np.arange(3)
    assert advice(replace(FINE, modulation=modulation), RIG)[0].startswith("sharp in places only")
    unseen = np.where(np.eye(3) > 0, np.nan, FINE.modulation)
    assert advice(replace(FINE, modulation=unseen), RIG) == ()


def test_hidden_nodes_are_reported_with_the_dark_among_them():
    (said,) = advice(replace(FINE, usable_share=0.7, dark_share=0.2), RIG)
    assert said.startswith(
        "only 70% of the view that should see the LCD is usable, 20% dark: clean the faces"
    )


def test_a_view_that_misses_most_of_the_lcd_is_not_good():
    (said,) = advice(replace(FINE, seen_share=0.13), RIG, UPRIGHT)
    assert said.startswith("by the rig file only 13% of the image sees the LCD: compare its lengths")


def test_flicker_asks_for_full_brightness_or_whole_periods():
    (said,) = advice(FINE, RIG, UPRIGHT, flicker_share=0.034)
    assert said.startswith("the light flickers by 3.4% from frame to frame: set the LCD to full brightness")


def test_several_faults_are_reported_light_first_then_place_then_focus():
    report = replace(FINE, bright_grey=60.0, mean_grey=32.0, score=0.6, blur_px=2.6)
    seen = replace(UPRIGHT, stray_share=0.3, place=replace(PLACE, right_px=-30.0, down_px=0.2))
    said = advice(report, RIG, seen)
    assert [line.split(":")[0].split(",")[0] for line in said] == [
        "too dark",
        "the picture lies 30 px left of where the rig file expects it",
        "out of focus (blur of about 2.6 px)",
        "stray light",
    ]


def test_what_lies_elsewhere_is_not_called_dirty():
    """As straight from `init`: the target's own period is hardly there, half of the nodes are of no use."""
    report = replace(FINE, on_target=0.49, usable_share=0.45, alignment=None)
    (said,) = advice(report, RIG, replace(UPRIGHT, place=replace(PLACE, right_px=71.0)))
    assert said.startswith("the picture lies 71 px right of where the rig file expects it")


def test_a_size_far_from_the_rig_files_is_not_called_out_of_focus():
    report = replace(FINE, score=0.7, blur_px=2.2, alignment=None)
    seen = replace(UPRIGHT, place=replace(PLACE, wider=0.2, higher=0.2))
    (said,) = advice(report, RIG, seen)
    assert said.startswith("the picture is +20.0% wide and +20.0% high against the rig file")


def test_without_the_lcd_a_picture_that_the_target_cannot_place_is_reported():
    (said,) = advice(replace(FINE, alignment=None), RIG)
    assert said.startswith("the picture lies far from where the rig file expects it")


@pytest.mark.parametrize(
    ("coarse", "fine", "taken"),
    [
        (PLACE, replace(PLACE, right_px=0.4), "fine"),
        (replace(PLACE, right_px=16.1), replace(PLACE, right_px=0.1), "coarse"),  # a period further on
        (replace(PLACE, wider=0.08), PLACE, "coarse"),
        (PLACE, None, "coarse"),
        (None, PLACE, "coarse"),  # mirrored: what the target says of its place means nothing
    ],
)
def test_the_target_gives_the_place_where_it_cannot_be_a_period_astray(coarse, fine, taken):
    place = placed(replace(FINE, alignment=fine), replace(UPRIGHT, place=coarse), 16)
    assert place is (fine if taken == "fine" else coarse)
