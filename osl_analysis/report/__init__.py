"""What a run reports: headline numbers, tables for a paper, a summary in ten lines, a page."""
