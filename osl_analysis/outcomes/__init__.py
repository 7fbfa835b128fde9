"""How a job of the workflow ends: with its results, or with refusals in their place; and its
log."""
