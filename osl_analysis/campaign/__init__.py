"""A campaign: its configuration, its sheet, and what the rules ask of both."""
