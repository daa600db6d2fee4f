"""Real and community images: checkerboard photographs and DIC-challenge speckle. Skipped where absent."""

import os
from pathlib import Path

import numpy as np
import pytest

from zeromethod.passive import correlate
from zeromethod.passive.measure import read_grey

DATA = Path(os.environ.get("ZEROMETHOD_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
needs_data = pytest.mark.skipif(not DATA.is_dir(), reason="no folder of photographs (ZEROMETHOD_DATA)")


def planted_dic(found, k: int) -> np.ndarray:
    """Error (rows, cols, 2) px; NaN where not valid. The command is v at rows of the deformed image."""
    command = np.genfromtxt(DATA / "dic" / "command.csv", delimiter=",")
    dv = np.interp(found.v + found.dv, command[:, 0], command[:, k // 50])
    error = np.stack([found.du, found.dv - dv], axis=-1)
    return np.where(found.valid[..., None], error, np.nan)


@needs_data
def test_dic_challenge_within_the_bars_over_all_rows_of_the_image():
    k = 400
    # the command is the same in every column
    images = (read_grey(DATA / "dic" / name)[:, :1000] for name in ("Reference.tif", f"P200_K{k}_N2.tif"))
    found = correlate(*images)
    # 10 of 1000 rows leave the image at the top, and the border's points with them.
    assert found.valid.mean() > 0.97
    error = planted_dic(found, k)
    total = np.sqrt(np.nanmean((error**2).sum(axis=-1)))
    rows = np.isfinite(error[..., 1]).any(axis=1)
    bias = np.sqrt(np.mean(np.nanmean(error[rows, :, 1], axis=1) ** 2))
    # The best public tools: 0.022 px total and 0.008 px bias of row means.
    assert total <= 0.022
    assert bias <= 0.006
    # The truth's kinks, which no window follows, count as noise here: 0.9 to 1.1, and a little.
    assert 0.9 < np.nanstd(error[..., 0] / found.sigma_u) < 1.15


@needs_data
def test_checkerboard_field_is_smooth_and_grows_smoothly_over_all_photographs():

    def seen(number: int) -> np.ndarray:
        """The mirror, u 62 to 247 and v as well, and what is next to it: half of the photograph."""
        return read_grey(DATA / "checkerboard" / f"image{number:02d}.tif")[40:270, 40:270]

    reference = seen(1)
    before, grown, last = None, [], None
    for number in range(2, 19, 4):
        before = correlate(reference, seen(number), guess=before)
        inside = (np.abs(before.u - 110) < 35) & (np.abs(before.v - 85) < 35)
        # The middle of the dome is in view on every photograph.
        assert before.valid[inside].mean() > 0.95
        field = np.where(before.valid[..., None], before.field, np.nan)
        # Smooth: a wrong order would be a step of 11 px or more, half of the texture's period.
        rows, cols = slice(10, 24), slice(15, 29)  # the middle: u 115 to 185, v 90 to 160 of the whole
        for axis in (0, 1):
            assert np.nanmax(np.abs(np.diff(field, axis=axis))) < 6.0
            assert np.nanmax(np.abs(np.diff(field[rows, cols], axis=axis))) < 1.0
        now = field[inside]
        if last is not None:
            # Growing smoothly: over four photographs no point of the middle moves by half a period.
            assert np.nanmax(np.abs(now - last)) < 5.0
        last = now
        grown.append(np.nanmean(now[:, 1]))
    assert np.all(np.diff(grown) < 0.02)
    assert grown[-1] < -1.5
