"""Means over the camera's pupil, drawn from ray maps by bench_pupil.frag."""

from __future__ import annotations

import moderngl

from zeromethod.gl import program
from zeromethod.optics.pupil import footprint_terms
from zeromethod.rig.model import Rig
from zeromethod.simulation.gpu_target import RenderTarget, ShaderPass, constants
from zeromethod.simulation.pupil import ON_RING, SAMPLES

_MEAN, _SPREAD, _LIGHT = range(3)


class GpuPupil:
    """Draws what the whole pupil sees; takes single rays and those of the mirror at rest."""

    def __init__(self, context: moderngl.Context, rig: Rig) -> None:
        """Raises InputError where the rig's rest surface cannot be used."""
        terms = footprint_terms(rig).reshape(6, 4)
        shifts = constants({f"shift_{k}": term for k, term in enumerate(terms)})
        unit = 1 / (rig.camera.psf_px**2 + 1 / 12)
        self._parts = [
            ShaderPass(
                context,
                program(
                    context, "bench_screen.vert", "bench_pupil.frag",
                    PART=part, SHIFTS=shifts, SAMPLES=SAMPLES, ON_RING=ON_RING, UNIT=unit,
                ),
            )
            for part in (_MEAN, _SPREAD, _LIGHT)
        ]  # fmt: skip

    def draw(self, rays: RenderTarget, rest: RenderTarget, mean: RenderTarget, spread: RenderTarget) -> None:
        """Fill `mean` (q, reflectance, 1) and `spread` (second moments of q) from single rays."""
        samplers = {"rays": rays.texture, "rest": rest.texture}
        self._parts[_MEAN].draw(mean, samplers)
        self._parts[_SPREAD].draw(spread, samplers)

    def draw_light(self, light: RenderTarget, mean: RenderTarget) -> None:
        """Fill `mean` from light of one channel."""
        self._parts[_LIGHT].draw(mean, {"rays": light.texture})

    def release(self) -> None:
        """Free the programs."""
        for part in self._parts:
            part.release()
