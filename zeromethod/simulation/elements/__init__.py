"""Elasticity of the simulated bench: the whole prism, with all its faces and supports, in finite elements.

Readings use `zeromethod.mechanics` instead. The two share nothing, so that a test of one
by the other is a test.
"""
