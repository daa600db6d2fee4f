"""Mechanics that readings rest on: what a load on the mirror does all over it, the body being finite."""
