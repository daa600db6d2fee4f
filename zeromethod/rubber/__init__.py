"""How a rig's rubber yields: the prism as it is, with its other faces and what holds them."""
