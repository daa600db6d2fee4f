"""Cameras and displays: what they must do, and how they are opened."""
