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
6. `findings.findings_table` stores the findings on the rows of a table in
   `findings/_impedance.parquet`: the source by its name, the grade as an enumeration, the estimates
   as a list. This decides. The rule `findings` makes it, once; those of the campaign are gathered
   in `tables/findings.parquet`, whose view for people is `findings.csv`.
7. `joining.joined` joins them to rows of result tables as typed columns: `doubts`, each with its
   source and estimates, by which means leave out rows (`stats/doubts.py`), figures open their
   markers, and claims and headline numbers count; wide intervals; and properties of the device.
   `joining.with_texts` writes `K_verdict`, `doubtful` and `remarks`, which people read.
8. `campaign.causes_in_campaign` counts trials by cause for `summary.json`, and `report.page` shows
   each trial its own findings.

The code says `torque_path`; readers see the title of `words.yaml`. Words decide nothing: with
all of them replaced, every number is the same (`tests/workflow/test_workflow.py`).
"""
