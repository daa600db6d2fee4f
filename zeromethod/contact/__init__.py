"""What touches the mirror: found per pixel, outlined in mm, followed from touch to lift."""

from zeromethod.contact.contact import Contact, ContactFigures, ContactImage, Probability
from zeromethod.contact.finder import ContactFinder, border_blur_px
from zeromethod.contact.force import ForceReader, TotalForce
from zeromethod.contact.lamp import Lamp
from zeromethod.contact.polygon import closed, evenly
from zeromethod.contact.pressure import PressureMap, pressure_map
from zeromethod.contact.stripes import Stripes, stripes
from zeromethod.contact.threads import ThreadFinder, finder_of

__all__ = [
    "Contact",
    "ContactFigures",
    "ContactFinder",
    "ContactImage",
    "ForceReader",
    "Lamp",
    "PressureMap",
    "Probability",
    "Stripes",
    "ThreadFinder",
    "TotalForce",
    "border_blur_px",
    "closed",
    "evenly",
    "finder_of",
    "pressure_map",
    "stripes",
]
