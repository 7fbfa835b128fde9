"""Imported first by the process that jobs are forked from: Ctrl-C, which a terminal sends to all, is Snakemake's.

The process is ended with Snakemake. Without this, Ctrl-C in its first second would end its imports with a traceback.
"""

import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
