"""What touches the mirror: found per pixel, outlined in mm, followed from touch to lift."""

from zeromethod.contact.contact import Contact, ContactFigures, Probability
from zeromethod.contact.finder import ContactFinder

__all__ = ["Contact", "ContactFigures", "ContactFinder", "Probability"]
