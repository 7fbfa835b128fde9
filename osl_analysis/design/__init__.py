"""Design of experiments: what intervals of K, B and I a protocol will give, and how long to record."""
