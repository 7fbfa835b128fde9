"""The jobs of the workflow: their requests, the process that runs them, and what is said at the end of a run."""
