"""A half-space under a normal force: what its inside does, in closed form.

Convention: the force presses at the origin along +z, into the half-space z > 0; lengths in mm, forces in N,
moduli and stresses in MPa. Source: Boussinesq 1885; Johnson 1985, Contact Mechanics, 3.2,
doi:10.1017/CBO9781139171731.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from zeromethod.arrays import Float


@dataclass(frozen=True)
class HalfSpaceForce:
    """Displacement and stress at places other than the origin under a force of 1 N."""

    shear_mpa: float
    poisson: float

    def displacement(self, x: Float, y: Float, z: Float) -> Float:
        """(3, ...) mm along x, y, z."""
        r = np.sqrt(x**2 + y**2 + z**2)
        spread = z / r**3 - (1 - 2 * self.poisson) / (r * (r + z))
        along = np.stack((x * spread, y * spread, z**2 / r**3 + 2 * (1 - self.poisson) / r))
        return np.asarray(along / (4 * np.pi * self.shear_mpa))

    def stress(self, x: Float, y: Float, z: Float) -> Float:
        """(3, 3, ...) MPa, tension positive."""
        at = np.stack((x, y, z))
        r = np.sqrt((at**2).sum(axis=0))
        down = np.zeros_like(at)
        down[2] = 1.0
        part = 1 / (r * (r + z))
        outer = z / r**3 - (1 - 2 * self.poisson) * part
        # gradients of z / r^3, of 1 / (r (r + z)) and of 1 / r
        by_cube = down / r**3 - 3 * z * at / r**5
        by_part = -(part**2) * (2 * at + z * at / r + down * r)
        outer_by = by_cube - (1 - 2 * self.poisson) * by_part
        gradient = np.empty((3, *at.shape))
        for i in range(2):
            gradient[i] = at[i] * outer_by
            gradient[i, i] += outer
        gradient[2] = z * by_cube + down * z / r**3 - 2 * (1 - self.poisson) * at / r**3
        stress = (gradient + gradient.swapaxes(0, 1)) / (4 * np.pi)
        # lambda x dilatation, finite for incompressible rubber
        stress[np.diag_indices(3)] -= self.poisson * z / (np.pi * r**3)
        return np.asarray(stress)
