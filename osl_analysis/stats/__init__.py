"""Statistics without physics: the one regression, covariances, sinusoids, repeats, comparison of
models."""
