"""The table of judgements: what is measured on a recording or a fit, its limit, what is said beyond it.

table.yaml has its words, `table` its row and the limits of the configuration; `recording` measures the rows that are of
recordings, `doubts` judges those that are columns of result tables; `findings` tells jobs which trials they use, and
the reader which causes concern which trials.
"""
