"""Trouble planted in a whole calibration: what the person reads names it, and depth is right without it."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace

import numpy as np
import pytest
from commissioning.setting_up_benches import Altered
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion

from zeromethod import Optics, RestMeasurement, limit_threads, open_devices
from zeromethod.commissioning.calibration import Calibration, Plan, Recorded, evaluate, record
from zeromethod.commissioning.calibration.rest import rest_notes
from zeromethod.commissioning.calibration.storing import document_of
from zeromethod.decoding import Reason
from zeromethod.devices.protocols import Frame

from .planted import Hand, nominal, read_elsewhere, truth

Float = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEPTHS_MM = (0.2, 0.15)
PLACES_MM = ((33.0, 0.0), (45.0, 2.0))
GHOST = 0.1
GHOST_PX = (10, -26)
"""Of the second reflection, and how far it lies off, camera px (rows, cols): some 20 LCD px."""
HAND_PICTURES = range(9, 15)
SHAPE = (128, 160)


def part(rows: slice, cols: slice) -> Mask:
    mask = np.zeros(SHAPE, dtype=bool)
    mask[rows, cols] = True
    return mask


DOUBLED = part(slice(None), slice(120, None))
SHADED = part(slice(70, 110), slice(15, 60))
ELSEWHERE = part(slice(20, 44), slice(20, 42))
ELSEWHERE_PX = 31
"""While the fringes are shown this patch shows what lies so many camera px away."""
DEAD = part(slice(5, None, 24), slice(66, 118, 7)) & ~ELSEWHERE


@dataclass
class Trouble(Hand):
    """A hand that presses when asked to, and also gets into the light while fringes are shown."""

    pictures: int = -1

    def part(self, words: str, total: int) -> AbstractContextManager[Callable[[], object]]:
        super().part(words, total)
        self.pictures = 0 if words == "rest map" else -1

        def advance() -> None:
            self.counts[words] = self.counts[words][0] + 1, total
            if words == "rest map":
                self.pictures += 1

        return nullcontext(advance)

    def spoil(self, light: Float) -> Float:
        """Light (rows, cols) as the troubled camera gets it."""
        seen = light + GHOST * np.where(DOUBLED, np.roll(light, GHOST_PX, (0, 1)), 0.0)
        if self.pictures in HAND_PICTURES:
            seen[SHADED] *= 0.5
        if self.pictures >= 0:
            seen[ELSEWHERE] = np.roll(light, -ELSEWHERE_PX, 1)[ELSEWHERE]
        seen[DEAD] *= 0.2
        return seen


@pytest.fixture(scope="module")
def troubled() -> tuple[Recorded, RestMeasurement, Trouble]:
    limit_threads(1)
    given = nominal()
    plan = Plan(DEPTHS_MM, 6e-4, light=False, delay=False, rest_frames=2, press_frames=8, patience_s=3.0)
    with open_devices(truth(given)) as devices:
        camera = devices.camera
        hand = Trouble(devices, DEPTHS_MM, PLACES_MM)
        black = given.camera.noise.black_grey

        def read(timeout_s: float) -> Frame:
            frame = camera.read(timeout_s)
            grey = np.clip(np.rint(hand.spoil(frame.image - black) + black), 0, 255)
            return replace(frame, image=grey.astype(np.uint8))

        devices.camera = Altered(camera, read=read)
        # Response and delay are as believed: the light is measured elsewhere.
        true = truth(given).display
        display = given.display.model_copy(update={"gamma": true.gamma, "latency_s": true.latency_s})
        return *record(given.model_copy(update={"display": display}), devices, plan, hand), hand


@pytest.fixture(scope="module")
def calibration(troubled: tuple[Recorded, RestMeasurement, Trouble]) -> Calibration:
    return evaluate(troubled[0], troubled[1])


@pytest.mark.parametrize(
    ("reason", "planted", "rim_px"),
    [
        # a second reflection is found over 9 x 9 px
        (Reason.SECOND_REFLECTION, DOUBLED, 5),
        (Reason.DISTURBED, SHADED, 3),
        (Reason.WRONG_ORDER, ELSEWHERE, 1),
        (Reason.DEAD, DEAD, 0),
    ],
)
def test_each_is_found_where_it_is_and_under_its_name(troubled, reason, planted, rim_px):
    rest = troubled[1].rest_map
    named = (rest.reason & int(reason)) != 0
    if rim_px:
        assert named[binary_erosion(planted, iterations=rim_px, border_value=1)].mean() > 0.97
        around = binary_dilation(planted, iterations=rim_px)
    else:
        assert named[planted & ~DOUBLED].all()
        around = planted
    # what is dead inside another trouble may go by that name
    assert np.count_nonzero(named & ~around) <= 0.002 * rest.reason.size


def test_what_is_left_is_right(troubled):
    rig, rest = truth(nominal()), troubled[1].rest_map
    v, u = np.mgrid[: rig.camera.rows, : rig.camera.columns].astype(float)
    apart = (rest.lcd_px - Optics(rig).rest_map(u, v))[rest.valid]
    assert rest.valid[~binary_dilation(DOUBLED | SHADED | ELSEWHERE | DEAD, iterations=5)].mean() > 0.99
    # sigma is 0.02 LCD px; the rim of the second reflection is off by its share of 20 px at the very most
    assert np.sqrt(np.mean(apart**2)) < 0.05
    assert np.abs(apart).max() < 2.0


def test_the_person_reads_of_each(troubled, calibration):
    notes = "\n".join(rest_notes(troubled[1]))
    for words in ("second reflection", "a hand in the light", "whole fringe periods off", "dead: "):
        assert words in notes
    share = float(notes.split("a second reflection of about ")[1].split("%")[0])
    # the mean over distances: half as much or twice, as one distance has it
    assert 5 <= share <= 20
    # the line of the table that says what was left out
    counts = document_of(calibration)["rest_map"]["reasons_px"]
    for name in ("second reflection", "disturbed", "wrong order", "dead"):
        assert counts[name] > 0


def test_a_sound_bench_is_not_accused(session):
    assert rest_notes(session[1]) == ()


def test_depth_is_not_silently_wrong(calibration):
    """Either the verdict says so, or known presses and another one are read within what is stated."""
    assert calibration.recorded.failure is None
    assert calibration.verdict.level != "bad"
    stated = 0.01 * calibration.depth_percent
    assert stated < 0.02
    for peak, depth in zip(calibration.peaks, DEPTHS_MM, strict=True):
        assert abs(peak.depth_mm / depth - 1) < 3 * np.hypot(stated, 6e-4 / depth)
    read_mm, true_mm = read_elsewhere(calibration, nominal(), 40.0)
    assert abs(read_mm / true_mm - 1) < 3 * stated
