"""The picture that the LCD shows at rest, for a printer: the pattern of a passive bench."""

from __future__ import annotations

from zeromethod.arrays import Bytes
from zeromethod.gl import create_context
from zeromethod.optics import Optics
from zeromethod.pattern.renderer import PatternRenderer
from zeromethod.pattern.response import Response
from zeromethod.pattern.target import Target
from zeromethod.rig.model import Rig
from zeromethod.warp.rest import Rest

GAMMA = 2.2
"""Of grey codes on paper: printers take a picture for sRGB, whose curve is near it."""


def printed_pattern(rig: Rig) -> Bytes:
    """Grey codes (rows, cols) of the rig's display while nothing presses.

    Row 0 at the top, as one looks at the side that faces the prism. Raises InputError for a rig that sees no
    display, or where nothing can draw.
    """
    rest = Rest.of(rig, Optics(rig))
    context = create_context()
    with context:
        lattice = rest.grid, rest.q, rest.display_size
        renderer = PatternRenderer(context, *lattice, Target.from_spec(rig.target), Response(GAMMA))
        image = renderer.image(rest.q)
    context.release()
    return image
