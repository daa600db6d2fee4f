"""Speed and accuracy against peers and physical bounds; not part of the installed package."""
