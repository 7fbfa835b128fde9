# SPDX-License-Identifier: Apache-2.0
"""What a run reports: headline numbers, tables for a paper, a summary in ten lines, a page."""
