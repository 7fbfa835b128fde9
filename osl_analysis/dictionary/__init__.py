# SPDX-License-Identifier: Apache-2.0
"""The data dictionary: meaning and unit of every column of every table that the pipeline writes.

The YAML files beside this module and `figures/figures.yaml` have a section per table, and in it a
line per column, `name: unit | meaning`, in two short forms: `K, _low, _high: N*m/rad | ...`
describes K, K_low and K_high, by the endings in `shared.yaml`; `include GROUP:` takes a group of
columns, and a name without a description a column, from `shared.yaml`. The section
`of_fits` has further columns in the tables of single trials, which only findings read.

Two things stand in no section: a result table with the column `trial` has `joint` and `side` behind
it, and the last column of every table is `data`. A new column is its line of code and its line
here; a test fails where one is missing.
"""
