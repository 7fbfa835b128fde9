# SPDX-License-Identifier: Apache-2.0
"""Simulated laboratories: trials with known truth, recorded in the file formats of real ones."""
