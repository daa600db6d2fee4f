"""The interactive surface: fingers on a cloth as pointers, and the projector's picture that they drive."""
