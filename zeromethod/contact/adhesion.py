"""Work of adhesion of a ball that sticks: force and outline together give it, either alone does not.

Source: Johnson, Kendall & Roberts 1971, Proc. R. Soc. A 324, 301, doi:10.1098/rspa.1971.0141.
"""

from __future__ import annotations

import math

from zeromethod.contact.contact import ContactFigures


def work_of_adhesion(contact: ContactFigures, radius_mm: float, modulus_mpa: float) -> tuple[float, float]:
    """Work of adhesion of a ball on rubber that is thick against the contact, and its standard deviation.

    Parameters
    ----------
    contact : ContactFigures
        Round, with its force.
    radius_mm : float
        Of the ball.
    modulus_mpa : float
        E / (1 - nu^2) of the rubber.

    Returns
    -------
    tuple of float
        J/m^2. The ball pulls the border outwards: it is as wide as under a larger force without adhesion.

    Notes
    -----
    A contact's border was moved inwards by half of what light may leak beside a ball, and its sigma says so.
    Rubber that sticks leaves the ball at a right angle and lets no light across: the border is moved back.
    What the picture's phase beside the border does to its place is the same in all frames.
    """
    seen_mm = math.sqrt(contact.area_mm2 / math.pi)
    radius = seen_mm + contact.leak_mm
    hertz_n = 4 * modulus_mpa * radius**3 / (3 * radius_mm)
    lacks_n = hertz_n - contact.force_n
    edge = 8 * math.pi * modulus_mpa * radius**3
    # of N/mm; the contact's radius counts by a^6 / a^3
    by_force = 2 * abs(lacks_n) / edge * contact.sigma_force_n
    by_radius = abs(6 * lacks_n * hertz_n - 3 * lacks_n**2) / (edge * radius)
    sigma_seen = contact.sigma_area_mm2 / (2 * math.pi * seen_mm)
    sigma_radius = math.sqrt(max(sigma_seen**2 - contact.leak_mm**2, 0.0))
    return 1e3 * lacks_n**2 / edge, 1e3 * math.hypot(by_force, by_radius * sigma_radius)
