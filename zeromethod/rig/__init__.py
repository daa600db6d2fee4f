"""Rig files: what a bench is made of and where everything stands."""
