# SPDX-License-Identifier: Apache-2.0
"""Convert recordings to trials: canonical columns in SI units, with quality and provenance."""
