"""For the process from which jobs are forked: importing this loads the search for gains, as each job would anew.

A new clone compiles it here, once, and not in each of its first jobs. All other runs find it on disk, and all jobs in
memory. Fits need it where the gains of a trial are known, which takes a parameter file.
"""

from osl_analysis.compiled import load_numba
from osl_analysis.model.compensator import Gains, compensated_gains
from osl_analysis.parameters import DrivetrainParameters

DEVICE = DrivetrainParameters(
    k_tau=0.1, n_m=9.0, B_m=0.1, J_m=0.1, f_C=0.1, f_G=0.01, n_T=5.0, K_s=700.0, B_j=1.0, J_j=0.01
)
"""Some device: compiled functions depend on the types of their arguments alone."""


def warm_up_gains() -> Gains:
    """Call the compiled functions of the search for gains, with arguments of the same types as a job's."""
    load_numba()
    return compensated_gains(100.0, 5.0, DEVICE)


GAINS = warm_up_gains()
"""The gains that were found."""
