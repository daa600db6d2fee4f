"""Areas cut off from the rest of the view, whose carrier order hangs by what was known before.

Phase is known up to whole periods, and neighbours settle the order of neighbours. Across nodes that
cannot be trusted (a fold, a touch, mixed pictures) nothing settles it, so that a region behind them may
be read whole periods wrong, with every node of it in perfect agreement.
"""

from __future__ import annotations

import cv2
import numpy as np

from zeromethod.arrays import Mask

TRUSTED_SHARE = 0.5
"""Share of an island's nodes that must have been trusted before for it to be believed."""


def doubtful(valid: Mask, trusted: Mask) -> Mask | None:
    """Find valid nodes whose order nothing settles; None when there are none.

    valid: (rows, cols) nodes measured well by themselves. trusted: those whose order was known in the
    frame before and cannot have slipped since. The largest connected region counts as known; any other
    only by at least half of it having been trusted.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(valid.view(np.uint8), connectivity=4)
    if count < 3:
        return None
    known = np.bincount(labels.ravel(), weights=trusted.ravel(), minlength=count)
    doubted = known < TRUSTED_SHARE * stats[:, cv2.CC_STAT_AREA]
    doubted[0] = False
    doubted[1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))] = False
    if not doubted.any():
        return None
    mask: Mask = doubted[labels]
    return mask
