"""Measurement of speed and memory: every stage from a frame to its objects, preparation and training."""
