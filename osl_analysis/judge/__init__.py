# SPDX-License-Identifier: Apache-2.0
"""Budgets and numbers of a fit become findings, and findings become sentences.

The way of one estimate, the damping of a trial whose torque is late, to the page:

1. `bench` puts its budget together (`bench/budgets.py`): a candidate model, `delay`, has the
   probability 0.9 and would change B by 0.3 N*m*s/rad, a row with the part
   `fault` and the source `torque_path`.
2. `stats.budget.Budget.verdict` compares it with what B needs (`doubtful.accuracy.B`, here 0.14)
   and with its half-width and range: B is doubtful by its source `torque_path`.
3. `judging.judged` makes of the verdicts of a row `Finding("torque_path", ..., Grade.DOUBTS)`, with
   all estimates that it moves; a failed check of the recording gives it its own name. What the
   budget knows of another motion is a remark, what nobody has measured is not checked.
4. What no budget tells, such as a wrong unit, the rules of `judge/rules.py` find by a number
   beyond its limit (`rules.numbers_beyond`), in any table.
5. `wording.worded` fills the sentences that `words.yaml` has under `findings`: what is wrong,
   how large it is, what to do.
6. `judging.marked` writes the verdicts into `K_verdict`, `B_verdict` and `I_verdict`, doubts into
   `doubtful`, and the rest into `remarks`. `campaign.campaign_findings` gathers all findings for
   `findings.csv`, from which `campaign.causes_in_campaign` counts trials for `summary.json`, and
   `report.page` shows each trial its own.

The code says `torque_path`; readers see the title of `words.yaml`. Words decide nothing.
"""
