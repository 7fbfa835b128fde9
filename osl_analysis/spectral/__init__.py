"""Spectra of a motion and its torque: its period, the best linear approximation, models in the
frequency domain; and the stepped sine that the joint did."""
