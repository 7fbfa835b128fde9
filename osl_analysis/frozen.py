"""Imported last before jobs are forked: what exists by then is never looked at by the garbage collection of a job.

The jobs share the memory of the process that they are forked from, until one of them writes to it. A garbage collection
writes to every object. None runs before: what it would free, the jobs would have to map anew.
"""

import gc

gc.freeze()
gc.enable()
