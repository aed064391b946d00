"""Configured runs: the command line, what it instantiates, single jobs in their folders, and sweeps."""
