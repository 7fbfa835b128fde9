"""The headline numbers of a campaign, and how they are written."""
