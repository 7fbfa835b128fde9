# SPDX-License-Identifier: Apache-2.0
"""The dynamometer and the actuator's bench.

From a recording to K: `commands/fit.py` calls, in this order, `motion`, which tells what moved and
which rows are fitted; a `record` has angle and torque behind one filter; `regression` has the
normal equations of its groups, estimates and their spread; `impedance` is Eq. 15 for each
amplitude and all of them. Then `evidence` puts beside it what else may make K, B and I, by
`friction` and `lags`.

The other experiments: `belt`, `parts_alone`, `calibration` and `torque_angle`.
"""
