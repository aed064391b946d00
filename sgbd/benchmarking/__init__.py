"""Measure speed and memory of all stages from frame to objects, of preparation, training and evaluation."""
