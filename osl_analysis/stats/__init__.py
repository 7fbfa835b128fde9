# SPDX-License-Identifier: Apache-2.0
"""Statistics without physics: the one regression, covariances, sinusoids, repeats, comparison of
models."""
