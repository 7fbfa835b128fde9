"""For the process from which simulating jobs are forked: importing this loads what each of them would load anew."""

from osl_analysis.compiled import load_numba

load_numba()
