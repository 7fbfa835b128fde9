"""Quality control: what is measured on a trial, and by which rule a failure flags or excludes it."""
