"""The jobs of the workflow: their requests, the processes that run them, and what is said at the
end of a run."""
