"""Elasticity of the simulated bench: the whole prism, with all its faces and supports, in finite elements.

Readings use `zeromethod.mechanics` instead, which shares only the half-space's closed form (`boussinesq`).
"""
