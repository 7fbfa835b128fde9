# SPDX-License-Identifier: Apache-2.0
"""Bring the columns of a trial on one uniform grid, filtered, with one time base.

Host stamps scatter. Either a device samples evenly and the scatter is latency (*even*), or each
sample was taken at its stamp (*true*). 0.5 ms of latency on the torque alone, taken for true, moves
B by 3 % and I by 13 %. With f_k the fast part of the stamp k rows earlier, and x' the slope of a
signal x, within 24 rows

    x = polynomial of degree 5 + sum over k of g_k x' f_k + noise,   k = -1 ... 2

All g_k are 0 of even samples, g_0 alone is 1 of true ones. Chi-square over all signals of a device
decides. Where it does not, the stamps decide, and what the other reading changes is a row of the
budget (`undecided_time_stamps`). A constant delay shows in no scatter: the source file states it.

| file | does |
|---|---|
| `grid` | the entrance: columns of a trial -> one uniform grid |
| `samples` | when the samples of a stream were taken |
| `device_clock` | the line through the stamps of an even device; values that a log repeats |
| `sample_count` | which samples are missing |
| `stamp_evidence` | the equation above, and the decision |
| `filters` | one zero-phase low-pass for all signals, derivatives, runs of rows |
| `plateaus`, `agreement` | what the checks of recordings see in a channel |

Example: `uniform_signals(trial, ["theta", "torque"], USUAL_FILTER).signals["theta"]`.

Numbers behind each choice, and what was tried, stand in docs/decisions.md, "How time is read".
"""
