"""Against OpenCV's Gray code on the same bench: as absolute, with as many frames, and far finer."""

import cv2
import numpy as np
from decoding.planted import PANEL, Bench
from scipy.ndimage import gaussian_filter1d

from zeromethod.decoding.fringes import FringeSequence, equal_shifts
from zeromethod.decoding.measuring import measure_rest
from zeromethod.decoding.periods import choose_periods


def gray_code(bench: Bench) -> tuple[np.ndarray, int]:
    """OpenCV's place (rows, cols, 2), NaN where it gives none, and the frames it takes."""
    pattern = cv2.structured_light.GrayCodePattern.create(*PANEL)
    pattern.setWhiteThreshold(8)
    _, pictures = pattern.generate()
    rng = np.random.default_rng(5)
    frames = []
    for picture in pictures:
        axis = 0 if np.ptp(picture[0]) else 1
        line = (picture[0] if axis == 0 else picture[:, 0]) / 255.0
        blurred = gaussian_filter1d(line.astype(float), bench.blur_px)
        light = bench.ambient + np.interp(bench.lcd[..., axis], np.arange(len(line)), blurred)
        signal = bench.peak * light
        noise = np.sqrt(bench.read**2 + signal / bench.electrons) * rng.normal(size=bench.shape)
        frames.append(np.clip(np.rint(bench.black + signal + noise), 0, 255).astype(np.uint8))
    place = np.full((*bench.shape, 2), np.nan)
    for v in range(bench.shape[0]):
        for u in range(bench.shape[1]):
            error, point = pattern.getProjPixel(frames, u, v)
            if not error:
                place[v, u] = point
    return place, len(frames)


def test_phase_shifting_beats_gray_code_with_like_many_frames():
    bench = Bench((48, 60))
    coded, frames = gray_code(bench)
    sequence = FringeSequence(choose_periods(PANEL[0]), equal_shifts(6))
    ours = measure_rest(bench.frames(sequence), sequence, size_px=PANEL).rest_map
    assert sequence.frames <= frames + 4
    known = np.isfinite(coded).all(axis=-1)
    coded_rms = np.sqrt(np.mean(np.square(coded - bench.lcd)[known]))
    our_rms = np.sqrt(np.mean(np.square(ours.lcd_px - bench.lcd)))
    # 1.5 px of blur dims Gray code's narrowest stripes: it gives up where they cannot be resolved.
    assert ours.valid.all()
    assert known.mean() < 0.6
    # Whole pixels at best: 1 / sqrt(12) = 0.29 px. Phases: 0.025 px.
    assert coded_rms > 0.2
    assert our_rms < 0.15 * coded_rms
