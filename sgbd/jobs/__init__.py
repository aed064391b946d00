"""Runs as they are configured: the command line, what it makes, jobs in their folders and sweeps of them."""
