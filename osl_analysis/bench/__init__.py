"""The dynamometer and the actuator's bench: an experiment per module, its columns, fit, table row
and summary.

* `motion` makes a `record` of any motion, in groups of rows; `regression` fits them, with columns
  of what else the torque may hold; an `analysis` is the fits to a trial.
* `friction` and `lags` tell what else may make K, B and I.
* `belt`, `parts_alone`, `impedance`, `calibration` and `torque_angle` are the experiments.
"""
