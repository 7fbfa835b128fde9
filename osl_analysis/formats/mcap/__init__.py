"""MCAP: finds the messages of a log, also in a file that is damaged or was never finished."""
