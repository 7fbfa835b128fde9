# SPDX-License-Identifier: Apache-2.0
"""A campaign: its configuration, its sheet, and what the rules ask of both."""
