"""How the jobs of the workflow run and end: warm processes, logs, and lines of progress."""
