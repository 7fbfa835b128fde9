"""Statistics: one linear regression (`regression.py`), and what stands on it."""
