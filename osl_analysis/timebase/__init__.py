"""One clock, one grid: the channels of a trial brought from their own stamps to uniform samples, before any filter."""
