"""Numbers of a fit become findings, and findings become sentences.

The way of one number, the share of Coulomb friction in the damping of a trial, to the page:

1. `bench` measures it: the column `coulomb_share` of `fits/impedance/TRIAL.csv`, here 0.31.
2. `findings.yaml` says under `rules` that it is evidence of the finding `friction` above the
   accuracy of B. `judging.rules_on` gathers the rules on a table, those of the configuration, too.
3. `judging.numbers_beyond` compares it with 0.05 (`doubtful.accuracy.B`):
   `Beyond("coulomb_share", 0.31, 0.05, "above", "friction")`.
4. `judging.causes_in` gathers the numbers of a row by what they are evidence of.
5. `judging.judged` makes of them `Finding("friction", "impedance", trial, Grade.NOTES, ...)`, a
   remark, since friction is a property of the device; a fault of the recording is a doubt. A fit
   has one table, `impedance`, which is written as two files. What the row could not show, rules
   with a condition find.
6. `words.words_of` fills the sentences that `findings.yaml` has under `findings`: what is wrong,
   how large it is, what to do.
7. `judging.marked` writes its title into the column `remarks` of the table, that of a doubt into
   `doubtful`.
   `campaign.campaign_findings` gathers all findings for `findings.csv`, from which
   `campaign.causes_in_campaign` counts trials for `summary.json`, and `report.trial_page` shows
   each trial its own.

The code says `friction`; readers see the title of `findings.yaml`. Words decide nothing.
"""
