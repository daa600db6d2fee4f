"""Elasticity that readings use: what a load on the mirror does all over it, by fields in closed form.

The simulated bench computes the same with finite elements (`zeromethod.simulation.elements`). The two share
no code, so that a test of one by the other is a test.
"""
