"""Rigid motion of camera, LCD and prism against each other: what it does to the warp, and how it is found."""
