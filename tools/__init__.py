"""Tools for who works on this repository; none is part of the package."""
