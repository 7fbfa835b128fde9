"""From markers and a moving force plate to the ankle's angle and torque, and to its impedance in a
perturbation."""
