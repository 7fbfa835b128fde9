"""Simulated laboratories: trials with known truth, recorded in the file formats of real ones."""
