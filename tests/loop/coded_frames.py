"""Frames with coded strips, without rendering: the light of an LCD in time, summed over many instants.

The panel is integrated numerically, so that the timing model is held against something that is not itself.
Between the strips there is the target, as the camera sees it when nulled.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache

import node_bench
import numpy as np

from zeromethod.devices.protocols import Frame
from zeromethod.exposure.pairing import PanelTiming
from zeromethod.exposure.presentation_log import PresentationLog
from zeromethod.exposure.strip_reading import StripReader
from zeromethod.pattern import Strips, Target
from zeromethod.pattern.strips import UNITS_PER_BIT, Strip, bits_of
from zeromethod.rig.model import DisplaySpec, Noise
from zeromethod.warp.grid import NodeGrid

SHAPE = (192, 320)
PANEL = (400, 300)
GRID = NodeGrid(SHAPE)
WHITE, BLACK = 200.0, 14.0
TARGET = Target()
NOISE = Noise(read_grey=2.0, black_grey=4.0)
INSTANTS = 400


def rest_warp() -> np.ndarray:
    u, v = GRID.mesh()
    return np.stack([40 + u, 54 + v], axis=-1)


def strips() -> Strips:
    found = Strips.of(GRID, rest_warp(), np.zeros(GRID.shape, np.bool_), PANEL)
    assert found is not None
    return found


STRIPS = strips()


def panel(refresh_hz: float = 60.0, rise_s: float = 0.004, scan: str = "down") -> DisplaySpec:
    return node_bench.panel(rise_s, refresh_hz, scan=scan, size=PANEL)


def reader(bits: int = 8) -> StripReader:
    return StripReader(STRIPS, NOISE, bits)


def _strip_light(strip: Strip, levels: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Share of white at columns u, averaged over the pixel by sampling."""
    parts = u[:, None] + np.linspace(-0.45, 0.45, 10)
    cell = np.floor((parts - strip.start_px) / strip.unit_px).astype(int)
    level = levels[np.clip(cell // UNITS_PER_BIT, 0, len(levels) - 1)]
    inner = np.isin(cell % UNITS_PER_BIT, (1, 2))
    return np.where(inner, 1 - level, level).mean(axis=1)


@cache
def _target_light() -> np.ndarray:
    """Share of white (rows, cols) where there is no strip."""
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    return (TARGET.light(u, v) / TARGET.mean - (1 - TARGET.contrast)) / (2 * TARGET.contrast)


def picture(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """Grey levels (rows, cols) without noise: (5,) levels of both strips, the target between."""
    v, u = np.arange(SHAPE[0], dtype=float), np.arange(SHAPE[1], dtype=float)
    share = _target_light().copy()
    share[v < STRIPS.first.edge_px] = _strip_light(STRIPS.first, first, u)
    share[v > STRIPS.last.edge_px] = _strip_light(STRIPS.last, last, u)
    return BLACK + (WHITE - BLACK) * share


def noisy(grey: np.ndarray, seed: int = 0, sigma: float = 2.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.clip(np.rint(rng.normal(grey, sigma)), 0, 255).astype(np.uint8)


@dataclass
class CodedBench:
    """Free-running camera and panel; a new code for every frame, `late_s` after it was read.

    delay_s: from presentation until the panel's first row truly starts to change. stamp_s: what the camera
    adds to the true middle of its exposures. wrong: code drawn in place of the one logged, by picture.
    """

    display: DisplaySpec = field(default_factory=panel)
    refresh_hz: float = 60.0
    camera_hz: float = 60.0
    exposure_s: float = 0.008
    phase: float = 0.3
    delay_s: float = 0.0
    stamp_s: float = 0.0
    late_s: float = 0.006
    noise: float = 2.0
    wrong: dict[int, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.log = PresentationLog((2, 2))
        self.timing = PanelTiming.of(self.display)
        self.shown: list[tuple[float, int]] = []

    def frames(self, count: int, start: int = 0) -> Iterator[Frame]:
        """Frames one after the other; every one is followed by a presentation at the next refresh."""
        self._present((start + self.phase) / self.camera_hz - 0.01)
        for number in range(start, start + count):
            begin_s = (number + self.phase) / self.camera_hz
            first, last = (self._levels(strip.panel_rows, begin_s) for strip in (STRIPS.first, STRIPS.last))
            middle_s = begin_s + 0.5 * self.exposure_s
            image = noisy(picture(first, last), number, self.noise)
            time_ns = round(1e9 * (middle_s + self.stamp_s))
            yield Frame(image, time_ns, round(1e9 * self.exposure_s), number)
            self._present(begin_s + self.exposure_s + self.late_s)

    def _present(self, after_s: float) -> None:
        count = len(self.shown)
        time_s = (math.floor(after_s * self.refresh_hz) + 1) / self.refresh_hz
        if self.shown:
            time_s = max(time_s, self.shown[-1][0])
        self.shown.append((time_s, self.wrong.get(count, count % 16)))
        self.log.record(round(1e9 * time_s), np.zeros((2, 2, 2)), None, count % 16)

    def _levels(self, rows: np.ndarray, begin_s: float) -> np.ndarray:
        """(5,) light of each bit's cells; before the first picture, half."""
        tau = self.display.rise_s / math.log(9)
        share = rows / (PANEL[1] - 1)
        scan_s = (1 - share if self.display.scan == "up" else share) / self.display.refresh_hz
        instants = begin_s + self.exposure_s * (np.arange(INSTANTS) + 0.5) / INSTANTS
        level = np.full(len(rows), 0.5)
        before = np.full(len(rows), 0.5)
        for time_s, code in self.shown:
            since = instants[:, None] - (time_s + self.delay_s + scan_s)
            risen = 1 - np.exp(-np.maximum(since, 0) / tau) if tau else 1.0 * (since > 0)
            bits = np.array(bits_of(code), dtype=float)
            level = level + risen.mean(axis=0) * (bits - before)
            before = bits
        return level
