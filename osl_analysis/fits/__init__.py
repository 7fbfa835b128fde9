"""Fits: one linear regression (`regression.py`) and its callers, which differ in their columns."""
