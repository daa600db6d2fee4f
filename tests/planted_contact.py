"""A round contact with a made-up image."""

import numpy as np

from zeromethod.contact import Contact, ContactImage, Probability

TURN = np.linspace(0, 2 * np.pi, 200, endpoint=False)


def planted(light, mm_per_px=0.03, radius_mm=2.0, scattered=0.1, number=1) -> Contact:
    """A contact about (40, 1) mm whose image has `light(x, y)` of world mm."""
    reach = np.arange(-radius_mm - 0.25, radius_mm + 0.25, mm_per_px)
    x, y = np.meshgrid(40 + reach, 1 + reach)
    image = ContactImage(light(x, y).astype(np.float32), mm_per_px, float(x[0, 0]), float(y[0, 0]))
    outline = np.stack([40 + radius_mm * np.cos(TURN), 1 + radius_mm * np.sin(TURN)], axis=-1)
    figures = dict.fromkeys(
        ("sigma_x_mm", "sigma_y_mm", "sigma_area_mm2", "angle_deg", "sigma_edge_mm"), 0.01
    )
    return Contact(
        id=number, x_mm=40.0, y_mm=1.0, area_mm2=np.pi * radius_mm**2, major_mm=2 * radius_mm,
        minor_mm=2 * radius_mm, scattered=scattered, **figures, outline_mm=outline,
        outline_px=20 * outline, probability=Probability(0, 0, np.zeros((1, 1), np.float32)), image=image,
    )  # fmt: skip
