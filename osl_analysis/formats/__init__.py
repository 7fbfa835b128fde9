"""File formats: one module each, which gives one `Recording`."""
