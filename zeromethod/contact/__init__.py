"""What touches the mirror: found per pixel, outlined in mm, followed from touch to lift."""

from zeromethod.contact.contact import Contact, ContactFigures, Probability
from zeromethod.contact.finder import ContactFinder
from zeromethod.contact.outline import closed, evenly

__all__ = ["Contact", "ContactFigures", "ContactFinder", "Probability", "closed", "evenly"]
