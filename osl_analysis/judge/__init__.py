"""The table of judgements: what is measured on a recording or a fit, its limit, what happens beyond it, in which words.

`table` has the types of its rows and the limits of the configuration. The rows stand in `channels` and `recording`,
what is measured on recordings; in `doubts`, columns of result tables; and in `impossible`, what is refused. `usable`
tells jobs which trials they use, and `findings` the reader which causes concern which trials.
"""
