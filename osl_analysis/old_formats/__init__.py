"""Readers of release 0.4.0, until ingest takes the recordings of `formats`."""
