"""Spectra of a motion and its torque: its period, the best linear approximation, models in the frequency domain."""
