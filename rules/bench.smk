# SPDX-License-Identifier: Apache-2.0
"""Trial -> rows of its fit, by experiment.

`config/experiments.yaml` says which tables a fit has. `estimates` is the first of them, `others` an
archive of the other ones.
"""

from osl_analysis.bench.evidence import DesiredImpedance
from osl_analysis.commands.fit import (
    FitOutputs,
    fit_trial_of_actuator,
    fit_trial_of_belt,
    fit_trial_of_calibration,
    fit_trial_of_impedance,
    fit_trial_of_torque_angle,
    fit_trial_of_transmission,
)
from osl_analysis.model.compensator import Weight


rule fit:
    """The estimates of one trial on the bench: K, B and I of Eq. 15, K_s of the belt, and so on."""
    input:
        device=device_of_fit,
        trial=trial_of_fit,
    output:
        estimates="<results>/fits/{experiment}/{trial}.csv",
        others="<results>/fits/{experiment}/{trial}.zip",
    log:
        "<logs>/{experiment}/{trial}.log",
    wildcard_constraints:
        experiment=name_pattern(SETTINGS_OF_FIT),
    priority: 2
    params:
        settings=lambda wildcards: SETTINGS_OF_FIT[wildcards.experiment],
        sheet_cells=stated_for_fit,
        windows=windows_of_fit,
        weight=lambda wildcards: (
            as_json(CONFIG.gain_weight) if wildcards.experiment == "impedance" else None
        ),
        made_by=MADE_BY,
    run:
        outputs = FitOutputs(Path(output.estimates), Path(output.others), CAMPAIGN.data)
        parameters = Path(input.device) if input.device else None
        trial = TrialFiles(wildcards.trial, [Path(input.trial)])
        if wildcards.experiment == "impedance":
            job(
                fit_trial_of_impedance,
                output,
                log,
                inputs=dict(trial=input.trial),
                arguments=dict(
                    parameters=parameters,
                    desired=DesiredImpedance(**params.sheet_cells),
                    weight=Weight(**params.weight),
                    settings=ImpedanceAnalysis(**params.settings),
                    windows=params.windows,
                    outputs=outputs,
                ),
                trial=trial,
            )
        elif wildcards.experiment == "belt":
            job(
                fit_trial_of_belt,
                output,
                log,
                inputs=dict(trial=input.trial),
                arguments=dict(
                    parameters=parameters,
                    settings=BeltAnalysis(**params.settings),
                    outputs=outputs,
                ),
                trial=trial,
            )
        elif wildcards.experiment == "transmission":
            job(
                fit_trial_of_transmission,
                output,
                log,
                inputs=dict(trial=input.trial),
                arguments=dict(
                    parameters=parameters,
                    settings=SteppedSineAnalysis(**params.settings),
                    outputs=outputs,
                ),
                trial=trial,
            )
        elif wildcards.experiment == "actuator":
            job(
                fit_trial_of_actuator,
                output,
                log,
                inputs=dict(trial=input.trial),
                arguments=dict(
                    parameters=parameters,
                    settings=ActuatorAnalysis(**params.settings),
                    outputs=outputs,
                ),
                trial=trial,
            )
        elif wildcards.experiment == "torque_angle":
            job(
                fit_trial_of_torque_angle,
                output,
                log,
                inputs=dict(trial=input.trial),
                arguments=dict(
                    settings=TorqueAngleAnalysis(**params.settings),
                    desired=params.sheet_cells["desired"],
                    outputs=outputs,
                ),
                trial=trial,
            )
        elif wildcards.experiment == "calibration":
            job(
                fit_trial_of_calibration,
                output,
                log,
                inputs=dict(trial=input.trial),
                arguments=dict(
                    settings=ImpedanceAnalysis(**params.settings),
                    sheet_cells=params.sheet_cells,
                    outputs=outputs,
                ),
                trial=trial,
            )
