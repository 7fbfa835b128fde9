"""MCAP: where the messages of a log stand, whatever has become of the file."""
