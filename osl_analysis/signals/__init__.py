# SPDX-License-Identifier: Apache-2.0
"""From the columns of a trial to uniform, filtered signals. What a successor needs:

**Question.** When was each sample taken? Host stamps scatter. Either the device samples evenly and
the scatter is latency (*even*), or the stamps are right (*true*), perhaps of values some loops old.
0.5 ms of latency on the torque alone, taken for true, moves B by 3 % and I by 13 %.

**Equation.** Let f_k be the fast part of the stamp k rows earlier, and x' the slope of a signal x.
Within 24 rows, beside a polynomial of degree 5,

    x = smooth + sum over k of g_k x' f_k + noise,   k = -1 ... 2

Even: all g_k = 0. True: g_0 = 1. Values a loops old: two neighbouring g_k share 1. Chi-square of
the hypotheses, over all signals of a device, decides; where it does not, the stamps do, and what
the other reading changes is a row of the budget (`undecided_time_stamps`).

| file | does |
|---|---|
| `grid` | the door: columns of a trial -> one uniform grid |
| `samples` | when the samples of a stream were taken |
| `device_clock` | the line through the stamps of an even device; values that a log repeats |
| `sample_count` | which samples are missing |
| `stamp_evidence` | the equation above, and the decision |
| `filters` | one zero-phase low-pass for all signals, derivatives, runs of rows |
| `plateaus`, `agreement` | what the checks of recordings see in a channel |

**Evidence for each choice** (`tests/signals`, recorders that share no code with the package):

* *All lags at once*: of 80 random logs by `stamp_recorders.recorded` (100 to
  1000 Hz, 3 us to 1 ms of jitter, 3 to 9 decimals, up to 1 % lost) none is firm with B off
  by 1 % or I by 3 %, and 5 are undecided. True stamps whose jitter their print hides are called
  even, to no effect.
* *The rounding of printed stamps is taken off*: without it four decimals at 1 kHz read g = 0.92.
* *A limit of 30 in chi-square*: all 197 clocks of the default campaign but three undecided ones
  read as with 22, 30 and a limit on g.
* *One line per clock*: a rate that changes for good leaves it by more than 0.1 s, and its stamps
  are kept; a polyline of six kinks cost 650 nodes for logs of which only tests knew.
* *A loop that follows the level of the promptest of 25 stamps* finds 3000 missing of 60,000 at
  their places to 0.1 %, behind waits of 0.1 steps, and 1 in 100 to 1 % behind waits of 0.5.
* *Promptest samples that scatter* tell a late host that loses samples, one in 20 to 5000, behind
  waits of 0.2 to 2 steps: 100 to 1000 Hz, three seeds each, all told, and none that loses nothing.
* *The promptest stamp, where waits are one-sided or in batches*: the mean of batches of 8 at 1 kHz
  is 3.5 ms late, B reads 3.9 for 5.
* *A cubic through the samples*: a sine of 5 Hz at 100 Hz is off by 2.6e-5.
* *Gaps up to 0.1/highest_hz are bridged*: a cubic is wrong by 5e-4 of the amplitude there.
* *One filter for all signals*: the angle alone behind 15 Hz makes B 3.43 for 3.

**Tried and dropped.** One response g by sixth differences (release 0.2.0: 100 of 375 logs were firm
and wrong, since they correlate the noise of neighbouring rows). One-sidedness of the scatter as
evidence (a loop with deadlines is late, too, and its stamps are true). Splines through jittered
stamps closer than half a step (they amplify noise 178 times). A local step for each row, blocks by
rate, pauses as a case of their own, the promptest 3 % instead of the promptest: no reading of the
default campaign or of 130 simulated recorders changed without them. Counting by the
levels on both sides of each long step (ten times as many misplaced), and by the spectrum of the
stamps, which tells how many a late host lost but not which. Whether sizes of batches confirm that
their last sample waited least.

**Not solved.** A constant delay shows in no jitter: state it. Even devices behind 2 ms of latency
that lose samples without a counter are refused beside another device.
"""
