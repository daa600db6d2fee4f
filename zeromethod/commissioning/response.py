"""Measuring the light: the LCD's response, what it does to pictures, the camera's noise, the view's falloff.

The mirror stays untouched all the time. Every pattern is shown until frames surely saw it alone.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.ndimage import uniform_filter

from zeromethod.arrays import Bytes, Float, Image, Mask
from zeromethod.calibration.bad_pixels import find_bad_pixels
from zeromethod.calibration.falloff import TILES, lit_pixels, measure_falloff, tile_means
from zeromethod.calibration.panel_dithering import spatial_dithering, temporal_dithering
from zeromethod.calibration.panel_faults import (
    FaultCheck,
    StepResponse,
    flicker,
    step_response,
    surround,
)
from zeromethod.calibration.photon_transfer import PhotonTransfer, Still, measure_noise, still, unclipped_mean
from zeromethod.calibration.response import RAMP_CODES, MeasuredResponse, measure_response
from zeromethod.calibration.viewing_angle import at_places, panel_exponents
from zeromethod.commissioning.light_result import LightResult
from zeromethod.commissioning.patterns import SettledPatterns, TimedPatterns, uniform_pattern
from zeromethod.devices.opening import Devices
from zeromethod.devices.protocols import Frame
from zeromethod.errors import MeasurementError
from zeromethod.optics import Optics
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest

MARGIN_S = 0.1
"""A pattern is shown longer than the rig states by this, as a new bench's rise is a guess."""

SERIES_CODES = (0, 126, 127, 255)
"""Codes that are looked at for long: of two neighbours at most one is no mixture on an LCD of 6 bits."""

SERIES_FRAMES = 24
LOOK_FRAMES = 4
RAMP_FRAMES = 2
"""The noise is found from these, too."""

PASSES = 2
STEPS = ((0, 255), (255, 0), (64, 192), (192, 64))
"""In pairs, there and back."""

STEP_REPEATS = 3
STEP_S = 0.4
STEP_FRAMES = 6
"""Steps are followed for so long, for so many frames, and for twice as long as they may take: the longest."""

SURROUND_CODES = (0, 255)
PATCH_CODES = (0, 127, 255)
SURROUND_REPEATS = 2
SURROUND_FRAMES = 2
PATCH_SHARE = 0.25
"""Side of the patch over that of the LCD's part in view."""

PICTURES = (
    2
    + len(SERIES_CODES)
    + len(STEPS) * STEP_REPEATS
    + len(STEPS) // 2
    + SURROUND_REPEATS * len(SURROUND_CODES) * len(PATCH_CODES)
    + PASSES * len(RAMP_CODES)
)
"""How many are shown in all: how often `on_picture` is called."""

_LEAST_PATCH_PX = 64
_EDGE_PX = 5


def measure_light(
    rig: Rig,
    devices: Devices,
    on_picture: Callable[[], object] = lambda: None,
) -> LightResult:
    """Show `PICTURES` pictures and learn what light they make.

    Nothing may touch the mirror. To be used in the main thread, as windows must be. CameraLost and
    DisplayLost pass.

    Raises
    ------
    MeasurementError
        The camera gives nothing, or does not see the LCD.
    """
    return _Measurement(rig, devices, on_picture).run()


class _Measurement:
    """One measurement of the light, stage by stage."""

    def __init__(self, rig: Rig, devices: Devices, on_picture: Callable[[], object]) -> None:
        self._rig = rig
        self._pictures = TimedPatterns(rig, devices, MARGIN_S)
        self._on_picture = on_picture
        self._full = float(2**rig.camera.bits - 1)
        self._step_s = max(STEP_S, 2 * self._pictures.hold_s, STEP_FRAMES / rig.camera.rate_hz)
        self._lit = np.ones((rig.camera.rows, rig.camera.columns), dtype=np.bool_)
        self._times_s: Float = np.zeros(0)
        self._settled = SettledPatterns(self._pictures)
        self._notes: list[str] = []

    def run(self) -> LightResult:
        self._find_lit()
        steps = tuple(self._steps())
        stacks = {code: self._series(code) for code in SERIES_CODES}
        times_s = self._times_s  # of the last one, which is white
        around = self._surround()
        grey, ramp_s, pairs = self._ramp()

        stills = {code: still(stack, self._lit, self._full) for code, stack in stacks.items()}
        long_ones = list(stills.values())
        noise = measure_noise(long_ones, self._lit)
        for every in (long_ones, [*long_ones, *pairs]):
            # pixels that blink raise the noise by which blinking is found
            bad = find_bad_pixels(stills[255], stills[0], self._lit, noise, every)
            noise = measure_noise(every, self._lit, bad != 0)
        good = self._lit & (bad == 0)
        response = self._response(grey, ramp_s, noise)
        places, size = self._tile_places(), (self._rig.display.columns, self._rig.display.rows)
        exponent = panel_exponents(response, places, size)
        if exponent is None and self._rig.display.response_exponent is not None:
            exponent = (1.0, 1.0), (1.0, 1.0)  # in place of those that the rig had
        falloff = measure_falloff(stills[255].mean, stills[0].mean, good)
        findings = [*around, *self._findings(stacks, stills, times_s, response, noise, good)]
        findings.append(max((step.overdrive for step in steps), key=lambda one: (one.found, one.size)))
        return LightResult(
            response=response,
            exponent=exponent,
            exponents=None if exponent is None else at_places(exponent, places, size),
            noise=noise,
            bad_pixels=bad,
            falloff=falloff,
            findings=tuple(findings),
            lit=self._lit,
            hold_s=self._pictures.hold_s,
            notes=tuple(self._notes),
        )

    def _series(self, code: int) -> Image:
        frames = self._held(code, SERIES_FRAMES)
        self._times_s = 1e-9 * np.array([frame.time_ns - frames[0].time_ns for frame in frames])
        return np.stack([frame.image for frame in frames])

    def _find_lit(self) -> None:
        """Find the pixels that look at the LCD."""
        bright = self._held(255, LOOK_FRAMES)
        self._settled.learn(bright)
        dark = self._held(0, LOOK_FRAMES)
        white, black = (np.stack([frame.image for frame in one]) for one in (bright, dark))
        self._lit = lit_pixels(white.mean(axis=0), black.mean(axis=0))
        swing = float(np.mean(white.mean(axis=0)[self._lit] - black.mean(axis=0)[self._lit]))
        if not self._lit.any() or swing < 0.02 * self._full:
            raise MeasurementError(
                f"response: the white LCD is {swing:.2g} grey levels brighter than the black one: is it "
                "seen, and the exposure long enough?"
            )
        saturated = float(np.mean(white[:, self._lit] >= self._full))
        if saturated > 0.01:
            self._notes.append(
                f"{100 * saturated:.0f} % of the white LCD's view is too bright for the camera, where "
                "nothing can be learnt: shorten the exposure, or lower the gain"
            )
        # what is cut off in some frames has a mean that is wrong
        self._lit &= ~(white >= self._full).any(axis=0)

    def _steps(self) -> list[StepResponse]:
        """Follow the light after steps; then hold pictures as long as it takes to settle."""
        times: dict[tuple[int, int], list[float]] = {step: [] for step in STEPS}
        shares: dict[tuple[int, int], list[Float]] = {step: [] for step in STEPS}
        for there, back in zip(STEPS[::2], STEPS[1::2], strict=True):
            before = np.mean([self._tiles(f.image) for f in self._held(there[0], LOOK_FRAMES)], axis=0)
            for step in (there, back) * STEP_REPEATS:
                after = []
                picture = uniform_pattern(self._rig, step[1])
                for since_s, frame in self._pictures.following(picture, self._step_s, STEP_FRAMES):
                    times[step].append(since_s)
                    after.append(self._tiles(frame.image))
                self._on_picture()
                settled = np.median(after[2 * len(after) // 3 :], axis=0)
                shares[step] += [(one - before) / (settled - before) for one in after]
                before = settled
            self._settled.forget()
        made = []
        for start, end in STEPS:
            light = np.stack(shares[start, end]).reshape(len(times[start, end]), -1)
            light = light[:, np.isfinite(light).all(axis=0)]
            words = f"when the LCD goes from code {start} to {end}"
            made.append(step_response(np.array(times[start, end]), light, words))
        stands_s = max(step.stands_s for step in made)
        if not np.isfinite([step.settled_s for step in made]).all():
            self._notes.append(
                f"the light has not settled {self._step_s:g} s after the picture changed: switch off dynamic "
                "contrast and power saving, and let the LCD warm up"
            )
            stands_s = 2 * self._step_s
        self._pictures.hold_s = max(self._pictures.hold_s, stands_s)
        return made

    def _held(self, code: int, count: int) -> list[Frame]:
        """Frames of an even picture."""
        return self._taken(uniform_pattern(self._rig, code), count)

    def _taken(self, picture: Bytes, count: int) -> list[Frame]:
        frames = self._settled.frames(picture, count)
        self._on_picture()
        return frames

    def _tiles(self, image: Image) -> Float:
        return tile_means(np.asarray(image, dtype=np.float64), self._lit)

    def _surround(self) -> tuple[FaultCheck, ...]:
        """Light of a patch by what surrounds it; nothing where the patch is not visible."""
        rest = Rest.of(self._rig, Optics(self._rig))
        size = np.array(rest.display_size) - 1
        places = np.clip(rest.q[rest.flags == 0], 0, size)
        middle, half = np.median(places, axis=0), 0.5 * PATCH_SHARE * np.ptp(places, axis=0)
        low = np.maximum(np.round(middle - half), 0).astype(int)
        high = np.round(middle + half).astype(int) + 1
        inside = (slice(low[1], high[1]), slice(low[0], high[0]))
        means = []
        for _ in range(SURROUND_REPEATS):
            for code in SURROUND_CODES:
                for patch in PATCH_CODES:
                    picture = uniform_pattern(self._rig, code)
                    picture[inside] = patch
                    taken = self._taken(picture, SURROUND_FRAMES)
                    means.append(np.mean([frame.image for frame in taken], axis=0))
        images = np.stack(means).reshape(
            SURROUND_REPEATS, len(SURROUND_CODES), len(PATCH_CODES), *means[0].shape
        )
        swing = images[:, 0, -1].mean(axis=0) - images[:, 0, 0].mean(axis=0)
        bright = (swing > 0.5 * np.percentile(swing[self._lit], 99.5)) & self._lit
        patch = uniform_filter(bright.astype(np.float64), _EDGE_PX) > 1 - 1e-9
        if np.count_nonzero(patch) < _LEAST_PATCH_PX:
            self._notes.append(
                "dynamic contrast was not looked for: the patch in the middle of the view is not seen"
            )
            return ()
        return surround(images[..., patch].mean(axis=-1))

    def _ramp(self) -> tuple[Float, Float, list[Still]]:
        """Every code, upwards, then downwards: grey of tiles as `measure_response` takes it, times, pairs."""
        grey: list[list[Float]] = []
        times: list[list[float]] = []
        images: dict[int, list[Image]] = {code: [] for code in RAMP_CODES}
        for number in range(PASSES):
            codes = RAMP_CODES if number % 2 == 0 else RAMP_CODES[::-1]
            taken = {code: self._held(code, RAMP_FRAMES) for code in codes}
            for code in codes:
                images[code] += [frame.image for frame in taken[code]]
            grey.append([np.mean([self._tiles(f.image) for f in taken[code]], axis=0) for code in RAMP_CODES])
            times.append([1e-9 * taken[code][0].time_ns for code in RAMP_CODES])
        stamps = np.array(times)
        pairs = [still(np.stack(images[code]), self._lit, self._full) for code in RAMP_CODES]
        return np.array(grey), stamps - stamps.min(), pairs

    def _response(self, grey: Float, times_s: Float, noise: PhotonTransfer) -> MeasuredResponse:
        grey = unclipped_mean(grey, np.sqrt(noise.variance(grey)))
        weights = np.nan_to_num(tile_means(self._lit.astype(np.float64), np.ones_like(self._lit)))
        return measure_response(RAMP_CODES, grey, times_s, weights)

    def _tile_places(self) -> Float:
        """(tile rows, tile cols, 2) LCD (column, row) that the tiles' middles see by the rig, px."""
        camera = self._rig.camera
        v, u = (
            (np.arange(count) + 0.5) * size / count - 0.5
            for size, count in zip((camera.rows, camera.columns), TILES, strict=True)
        )
        return Optics(self._rig).rest_map(*np.meshgrid(u, v))

    def _findings(
        self,
        stacks: dict[int, Image],
        stills: dict[int, Still],
        times_s: Float,
        response: MeasuredResponse,
        noise: PhotonTransfer,
        good: Mask,
    ) -> list[FaultCheck]:
        white, black = stills[255], stills[0]
        level_noise = float(
            np.sqrt(noise.variance(white.mean[self._lit]).mean() / np.count_nonzero(self._lit))
        )
        found = list(flicker(times_s, white.level, black.level, level_noise))
        between = [code for code in SERIES_CODES if 0 < code < 255]
        slope = np.gradient(response.whole.light, response.codes) * response.swing_grey
        steps = [float(np.interp(code, response.codes, slope)) for code in between]
        found.append(temporal_dithering([stacks[code] for code in between], between, steps, good))
        halves = {code: _halves(stack) for code, stack in stacks.items()}
        chosen = [halves[code] for code in between]
        found.append(spatial_dithering(chosen, between, steps, halves[255], halves[0], good))
        return found


def _halves(stack: Image) -> Float:
    """Mean of the even and of the odd frames' pairs: a drift does the same to both."""
    number = np.arange(len(stack)) // 4 % 2
    return np.stack([stack[number == half].mean(axis=0) for half in range(2)])
