"""The dynamometer and the actuator's bench: an experiment per module, its columns, fit, table row
and summary."""
