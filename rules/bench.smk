# SPDX-License-Identifier: Apache-2.0
"""Trial -> rows of its fit, by experiment.

Experiments are one table: `config/experiments.yaml` says what is recorded and which tables a fit has,
`FITS` in `commands/fit.py` names the function that fits a trial. It gets the trial, and as
`arguments` what else it takes. The first file has the estimates, `others` is an archive of the other
tables of the trial.
"""

from osl_analysis.commands.fit import FITS


rule fit:
    """The estimates of one trial on the bench: K, B and I of Eq. 15, K_s of the belt, and so on."""
    input:
        device_of_fit,
        trial=trial_of_fit,
    output:
        estimates="<results>/fits/{experiment}/{trial}.csv",
        others="<results>/fits/{experiment}/{trial}.zip",
    log:
        "<logs>/{experiment}/{trial}.log",
    wildcard_constraints:
        experiment=name_pattern(FITS),
    priority: 2
    params:
        arguments=arguments_of_fit,
        made_by=MADE_BY,
    run:
        job(FITS[wildcards.experiment], input, output, params, log)
