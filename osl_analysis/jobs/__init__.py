"""How the jobs of the workflow run: warm processes, limits of memory, lines of progress."""
