"""Imported first by the process that jobs are forked from, whose imports nothing interrupts.

Ctrl-C, which a terminal sends to all, is Snakemake's: in the first second it would end the imports with a traceback,
and the process is ended with Snakemake anyhow. Garbage is not looked for until `osl_analysis.frozen`: almost all that
imports make stays, and looking takes a fifth of their time.
"""

import gc
import signal

signal.signal(signal.SIGINT, signal.SIG_IGN)
gc.disable()
