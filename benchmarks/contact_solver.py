"""The simulated bench's contact solver against closed forms, and next to ContactMechanics.

A ball and a flat punch on a half-space on 192 x 192 cells, both to the same tolerance, and a ball that sticks
(JKR). Times are of one process, taken in turn, kernels made each time by both. ContactMechanics is needed for
this benchmark alone: pip install 'zeromethod[peers]'.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from importlib import import_module
from typing import Any

import numpy as np

from benchmarks.report import Figure, Report, benchmark, start
from zeromethod.arrays import Float
from zeromethod.errors import InputError
from zeromethod.rig.tables import Rubber
from zeromethod.simulation.contact.compliance import Compliance
from zeromethod.simulation.contact.objects import Form, Held, Solid
from zeromethod.simulation.contact.patch import Lattice, Patch, Presser
from zeromethod.thread_limits import limit_threads

RADIUS_MM, PUNCH_MM, FORCE_N, STICKING_N, ADHESION_J_M2 = 5.0, 1.0, 0.1, 0.02, 0.05
TOLERANCE = 1e-6
"""Of the gap in contact, over the object's depth."""
TIMES, QUICK_TIMES = 9, 3
WORST_PERCENT, SLOWEST = 0.3, 0.5


def _peer(lattice: Lattice, heights_mm: Float, modulus_mpa: float, depth_mm: float) -> Any:
    """Its solution under the same force on the same cells."""
    topography, factory = import_module("SurfaceTopography"), import_module("ContactMechanics.Factory")
    size = lattice.cols * lattice.pitch_mm, lattice.rows * lattice.pitch_mm
    surface = topography.Topography(heights_mm.T, size)
    system = factory.make_system(substrate="free", young=modulus_mpa, surface=surface)
    return system.minimize_proxy(external_force=FORCE_N, pentol=TOLERANCE * depth_mm)


def _best(*works: Callable[[], object], times: int) -> list[float]:
    """Least processor time of each, s, taken in turn."""
    found = np.full((times, len(works)), np.inf)
    for row in found:
        for k, work in enumerate(works):
            began = time.process_time()
            work()
            row[k] = time.process_time() - began
    return [float(one) for one in found.min(axis=0)]


def _percent(value: float, true: float) -> float:
    return 100 * (value / true - 1)


@benchmark("contact_solver", __doc__)
def command(quick: bool) -> Report:
    """Solve each, and compare."""
    try:
        import_module("ContactMechanics")
    except ImportError:
        raise InputError("ContactMechanics: not installed: pip install 'zeromethod[peers]'") from None
    limit_threads()
    compliance = Compliance(Rubber(youngs_modulus_mpa=1.6))
    modulus = compliance.modulus_mpa

    def solved(solid: Solid, force_n: float = FORCE_N) -> Patch:
        return Presser(Held(solid, 0.0, 0.0, force_n=force_n), compliance).patch([])

    ball, punch = Solid(Form.BALL, RADIUS_MM), Solid(Form.PUNCH, PUNCH_MM)
    contact = (3 * FORCE_N * RADIUS_MM / (4 * modulus)) ** (1 / 3)
    depth, flat = contact**2 / RADIUS_MM, FORCE_N / (2 * modulus * PUNCH_MM)
    found = solved(ball)
    lattice = found.lattice
    along, across = lattice.mesh()
    heights = -(along**2 + across**2) / (2 * RADIUS_MM)
    peer = _peer(lattice, heights, modulus, depth)
    largest = 1.5 * FORCE_N / (np.pi * contact**2)
    work = 1e-3 * ADHESION_J_M2
    sticking = solved(Solid(Form.BALL, RADIUS_MM, adhesion_j_m2=ADHESION_J_M2), STICKING_N)
    held = sticking.sharp_mm or np.nan
    jkr_n = 4 * modulus * held**3 / (3 * RADIUS_MM) - np.sqrt(8 * np.pi * work * modulus * held**3)
    errors = {
        "ball: depth": _percent(found.pressed.depth_mm, depth),
        "ball: greatest pressure": _percent(float(found.pressed.pressure_mpa.max()), largest),
        "punch: depth": _percent(solved(punch).pressed.depth_mm, flat),
        "ball that sticks: force": _percent(sticking.force_n, jkr_n),
    }
    peer_errors = {
        "ball: depth": _percent(float(peer.offset), depth),
        "ball: greatest pressure": _percent(float(peer.jac.max()) / lattice.pitch_mm**2, largest),
    }
    own_s, peer_s = _best(
        lambda: solved(ball), lambda: _peer(lattice, heights, modulus, depth),
        times=QUICK_TIMES if quick else TIMES,
    )  # fmt: skip
    worst = max(map(abs, errors.values()))
    ratio = own_s / peer_s
    figures = [
        Figure("worst error", f"{worst:.3f} %", f"{WORST_PERCENT} %", worst <= WORST_PERCENT),
        Figure("time over ContactMechanics'", f"{ratio:.2f}", f"{SLOWEST}", ratio <= SLOWEST),
        Figure("processor time of a ball", f"{1e3 * own_s:.0f} and {1e3 * peer_s:.0f} ms"),
    ]
    rows = [("closed form", "error", "ContactMechanics")]
    rows += [
        (name, f"{error:+.4f} %", f"{peer_errors[name]:+.4f} %" if name in peer_errors else "")
        for name, error in errors.items()
    ]
    data = {"percent": errors, "peer_percent": peer_errors, "own_s": own_s, "peer_s": peer_s}
    return Report("Contact solver", figures, rows, data)


if __name__ == "__main__":
    start(command)
