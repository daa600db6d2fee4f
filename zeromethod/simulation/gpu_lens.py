"""A camera pixel's response to where light falls, lens and pixel in one, as numbers for bench_light.frag."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.polynomial import Chebyshev, Polynomial
from scipy.special import ndtr

from zeromethod.arrays import Float

SIGMAS = 4.0
"""The lens's Gaussian is cut there: 1e-5 of the light is beyond, once convolved with the pixel."""
LEAST_PSF_PX = 0.05
"""A lens sharper than that is none: its polynomial would grow long."""
_ACCURACY = 4e-6
_MOST_TERMS = 64


def before(x: Float, psf_px: float) -> Float:
    """Share of the response before x (camera px from the pixel's centre): box (1 px) * Gaussian (psf_px)."""

    def ramp(to: Float) -> Float:
        # integral of the Gaussian's cumulative
        z = to / psf_px
        value: Float = to * ndtr(z) + psf_px * np.exp(-0.5 * z * z) / np.sqrt(2 * np.pi)
        return value

    return ramp(x + 0.5) - ramp(x - 0.5)


def _support_px(psf_px: float) -> float:
    return 0.5 + SIGMAS * psf_px if psf_px >= LEAST_PSF_PX else 0.5


def _spread_px(psf_px: float) -> float:
    """Standard deviation of the response along u and along v."""
    return float(np.sqrt(psf_px**2 + 1 / 12))


def reach_px(psf_px: float) -> float:
    """Camera px from a pixel's centre, along u and v, beyond which it gets no light; some more for shear."""
    support = _support_px(psf_px)
    return support if psf_px < LEAST_PSF_PX else float(np.hypot(support, _spread_px(psf_px)))


def lens_defines(psf_px: float) -> dict[str, Any]:
    """Constants of bench_light.frag for a Gaussian of sigma `psf_px` (camera px); 0: the pixel alone."""
    support = _support_px(psf_px)
    if psf_px < LEAST_PSF_PX:
        return {"LENS": 0, "REACH": support, "SPREAD": _spread_px(psf_px)}
    terms = [f"{term:.9e}" for term in _odd_polynomial(psf_px, support)]
    return {"LENS": 1, "REACH": support, "SPREAD": _spread_px(psf_px), "RESPONSE": _in_pairs(terms, "t")}


def _in_pairs(terms: list[str], power: str) -> str:
    """Polynomial in t by Estrin's scheme: many short chains keep a CPU busier than Horner's long one."""
    if len(terms) == 1:
        return terms[0]
    sums = [f"({low} + {power} * {high})" for low, high in zip(terms[::2], terms[1::2], strict=False)]
    return _in_pairs(sums + terms[len(terms) & ~1 :], f"({power} * {power})")


def _odd_polynomial(psf_px: float, support: float) -> Float:
    """Coefficients c with before(x) - 1/2 = x sum c_k t^k, t = 2 (x / support)^2 - 1, for |x| <= support.

    In t float32 keeps its digits; the error is 4e-6 or less.
    """
    slope = before(np.array([0.5e-4]), psf_px)[0] * 2e4 - 1e4

    def quotient(t: Float) -> Float:
        x = support * np.sqrt(np.maximum(t + 1, 0) / 2)
        far = x > 1e-4
        x = np.where(far, x, 1.0)
        return np.where(far, (before(x, psf_px) - 0.5) / x, slope)

    x = np.linspace(0.0, support, 2001)
    t = 2 * (x / support) ** 2 - 1
    exact = before(x, psf_px) - 0.5
    for degree in range(6, _MOST_TERMS):
        fit = Chebyshev.interpolate(quotient, degree)
        if np.abs(x * fit(t) - exact).max() < _ACCURACY:
            break
    return np.asarray(fit.convert(kind=Polynomial).coef, dtype=np.float64)
