# SPDX-License-Identifier: Apache-2.0
"""The list of figures, which the workflow, the command line and the tests read.

A new figure NAME is a module NAME here with a function `draw` of its plotted numbers, and with a
function `points` if these are not the rows of its result table; an entry in `figures.yaml`; and its
test.
"""
