"""The interactive surface: fingers on a cloth become pointers, and the projector's picture follows them."""
