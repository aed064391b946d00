"""Measuring speed and memory: every stage of the way from a frame to its objects, and of preparation and training."""
