"""Which elastic bodies a rig's rubber may be, and how far each of them may be from the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from zeromethod.mechanics.body import body_of
from zeromethod.mechanics.gaussian_load import Elastic, HalfSpace, LayerBody, PrismBody
from zeromethod.optics.prism import PrismGeometry
from zeromethod.rig.model import Rig
from zeromethod.rig.tables import FaceSupports

_THICKNESS_SIGMA_MM = 0.1
"""Of a layer whose rig file gives none: what calipers read off soft rubber."""
_POISSON_SIGMA = 0.003
"""Of Poisson's ratio, where the rig file gives none: silicone's bulk modulus is some 1 GPa, a hundred to a
thousand times its shear modulus."""

_REACHES_MIRROR = 0.1
"""Error of what a prism's faces add on the mirror, over what is left on them of what their supports do not
allow: that is short-waved there. With both faces bonded 1.2 % for 15 %, against finite elements."""


@dataclass(frozen=True)
class Candidate:
    """A body that the rubber may be. others: it, one standard deviation away in one of its numbers each."""

    body: Elastic
    others: tuple[Elastic, ...] = ()


def candidates_of(rig: Rig) -> tuple[Callable[[], Candidate], ...]:
    """Makers of a rig's candidates, which may take seconds; none where a rig says that nothing is elastic.

    Where what holds the rubber is not known: a half-space, or a base bonded somewhere between as deep as this
    prism is and half as deep.
    """
    rubber = rig.rubber
    if rubber.body == "none":
        return ()
    if rubber.support is None:
        deep = LayerBody(PrismGeometry(rig.prism).thickness_mm, rubber.poisson, True)
        deeper, nearer = (replace(deep, thickness_mm=by * deep.thickness_mm) for by in (4.0, 0.5**0.5))
        return lambda: Candidate(HalfSpace(), (deeper,)), lambda: Candidate(nearer, (deep,))
    if isinstance(rubber.support, FaceSupports):
        return (lambda: _held_prism(rig),)
    if rubber.thickness_mm is None:
        return (lambda: Candidate(HalfSpace()),)
    layer = LayerBody(rubber.thickness_mm, rubber.poisson, rubber.support == "bonded")
    thicker = replace(
        layer, thickness_mm=layer.thickness_mm + (rubber.thickness_sigma_mm or _THICKNESS_SIGMA_MM)
    )
    softer = replace(layer, poisson=max(layer.poisson - (rubber.poisson_sigma or _POISSON_SIGMA), 0.0))
    return (lambda: Candidate(layer, (thicker, softer)),)


def _held_prism(rig: Rig) -> Candidate:
    kernel = body_of(rig)
    assert kernel is not None
    return Candidate(PrismBody(kernel), (PrismBody(kernel, 1.0 + _REACHES_MIRROR * kernel.left),))
