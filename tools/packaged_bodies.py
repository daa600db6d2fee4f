"""Works out what the packaged rigs' rubber adds to a half-space's answer, so that no user waits for it.

    python -m tools.packaged_bodies

It takes half a minute and the extra "elements", and writes calibration/bodies anew.
"""

from __future__ import annotations

import os
import shutil

from zeromethod import load_rig
from zeromethod.mechanics.body import body_of
from zeromethod.resources import resource
from zeromethod.rig.load import packaged_rigs
from zeromethod.rig.tables import FaceSupports
from zeromethod.simulation.elements.prism import HeldPrism, prism_kernel


def main() -> None:
    """Write the arrays of every packaged rig that says what holds each face of its prism."""
    folder = resource("calibration", "bodies")
    shutil.rmtree(folder, ignore_errors=True)
    os.environ["ZEROMETHOD_CACHE"] = str(folder)
    for name in packaged_rigs():
        rig = load_rig(name)
        if isinstance(rig.rubber.support, FaceSupports):
            prism_kernel(HeldPrism.of(rig.prism, rig.rubber.support, rig.rubber.poisson))
            body_of(rig)
    print(*sorted(path.name for path in folder.iterdir()), sep="\n")


if __name__ == "__main__":
    main()
