"""The dynamometer and the actuator's bench: an experiment per module, its columns, fit, table row
and summary.

* `motion` makes a `record` of any motion, in groups of rows; `regression` fits
  them.
* `effects` has the columns of what else the torque may hold, `joint_inference` the choice of what
  gives K, B and I.
* `belt`, `transmission`, `actuator_alone`, `impedance`, `calibration` and `torque_angle` are the
  experiments.
"""
