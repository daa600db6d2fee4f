"""Images of contacts as tiles of one size, as a table of a recording holds them."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np

from zeromethod.arrays import Image
from zeromethod.contact import Contact, ContactImage

TILE_PX = 64
MOST_TILES = 16
"""A larger contact's image is kept coarser."""


def tiles(contact: Contact) -> Iterator[dict[str, object]]:
    """Rows of a contact's image, as `zeromethod.recording.schema.CONTACT_IMAGES` has them; none without."""
    image = contact.image
    if image is None:
        return
    image = _coarser(image)
    rows, cols = image.light.shape
    for row in range(0, rows, TILE_PX):
        for col in range(0, cols, TILE_PX):
            part = image.light[row : row + TILE_PX, col : col + TILE_PX]
            light = np.full((TILE_PX, TILE_PX), np.nan, np.float16)
            light[: part.shape[0], : part.shape[1]] = part
            place = {"x_mm": image.x_mm, "y_mm": image.y_mm, "mm_per_px": image.mm_per_px}
            sizes = {"rows": rows, "cols": cols, "row": row, "col": col}
            yield {"id": contact.id, **place, **sizes, "light": light}


def images(rows: Image) -> dict[int, ContactImage]:
    """Images of the contacts of one step, by id, of the table's rows; what is missing of them is NaN."""
    found: dict[int, ContactImage] = {}
    for tile in rows:
        number = int(tile["id"])
        if number not in found:
            light = np.full((int(tile["rows"]), int(tile["cols"])), np.nan, np.float32)
            place = (float(tile[name]) for name in ("mm_per_px", "x_mm", "y_mm"))
            found[number] = ContactImage(light, *place)
        part = found[number].light[tile["row"] : tile["row"] + TILE_PX, tile["col"] : tile["col"] + TILE_PX]
        part[:] = tile["light"][: part.shape[0], : part.shape[1]]
    return found


def _coarser(image: ContactImage) -> ContactImage:
    """The image with as many pixels as fit into `MOST_TILES`: means of squares of them."""
    rows, cols = image.light.shape
    factor = 1
    while -(-rows // (factor * TILE_PX)) * -(-cols // (factor * TILE_PX)) > MOST_TILES:
        factor += 1
    if factor == 1:
        return image
    size = cols // factor, rows // factor
    light = cv2.resize(
        image.light[: size[1] * factor, : size[0] * factor], size, interpolation=cv2.INTER_AREA
    )
    shift = image.mm_per_px * (factor - 1) / 2
    pitch = factor * image.mm_per_px
    return ContactImage(np.asarray(light, np.float32), pitch, image.x_mm + shift, image.y_mm + shift)
