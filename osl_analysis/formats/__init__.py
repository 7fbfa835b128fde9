"""Formats of recordings: from bytes to arrays of numbers. Nothing here knows a leg, a signal or an
SI unit."""
