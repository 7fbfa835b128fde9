"""How a job of the workflow ends: with results, or with refusals in their place; and its log."""
