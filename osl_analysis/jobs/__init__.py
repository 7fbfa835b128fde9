"""How the jobs of the workflow run: warm processes, and lines of progress."""
