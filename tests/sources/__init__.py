"""Tests of the readers of datasets."""
