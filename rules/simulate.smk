# SPDX-License-Identifier: Apache-2.0
"""Recordings of a simulated campaign, where the configuration names a `simulation`."""

from osl_analysis.campaign.configuration import SharedChoices
from osl_analysis.commands.simulate import simulate_planned_trial, write_sheet

SIMULATED_FILES = []
if CONFIG.simulation:
    SIMULATED_FILES += [CONFIG.sheet, *(file for trial in TRIALS for file in CAMPAIGN.logs(trial))]

    rule trial_sheet:
        """The sample sheet: a row for each trial."""
        input:
            settings_path=CONFIG.simulation,
        output:
            sheet=CONFIG.sheet,
        log:
            "<logs>/trial_sheet.log",
        localrule: True
        params:
            made_by=MADE_BY,
        run:
            job(
                write_sheet,
                output,
                log,
                inputs=dict(settings_path=input.settings_path),
                arguments=dict(sheet=Path(output.sheet)),
                simulates=True,
            )

    rule simulate_dynamometer:
        """The log of a trial on the dynamometer, and the truth beside it."""
        input:
            SIMULATION_FILES,
            settings_path=CONFIG.simulation,
        output:
            "<raw>/dynamometer/{trial}.mcap",
            "<raw>/truth/{trial}.json",
        log:
            "<logs>/simulate/{trial}.log",
        wildcard_constraints:
            trial=name_pattern(CAMPAIGN.trials(*ON_DYNAMOMETER)),
        priority: 1
        params:
            campaign_folder=lambda wildcards: str(CONFIG.raw_data),
            followed=lambda wildcards: as_json(CONFIG.shared(experiment(wildcards).follows)),
            made_by=MADE_BY,
        run:
            job(
                simulate_planned_trial,
                output,
                log,
                inputs=dict(settings_path=input.settings_path),
                arguments=dict(
                    campaign_folder=Path(params.campaign_folder),
                    trial=wildcards.trial,
                    followed=SharedChoices(**params.followed),
                ),
                simulates=True,
            )

    use rule simulate_dynamometer as simulate_actuator with:
        output:
            "<raw>/actuator/{trial}.mcap",
            "<raw>/truth/{trial}.json",
        wildcard_constraints:
            trial=name_pattern(CAMPAIGN.trials("actuator")),

    use rule simulate_dynamometer as simulate_capture with:
        output:
            "<raw>/vicon/{trial}.c3d",
            "<raw>/truth/{trial}.json",
        wildcard_constraints:
            trial=name_pattern(CAMPAIGN.trials("static", "plate")),

    use rule simulate_dynamometer as simulate_crossing with:
        output:
            "<raw>/leg/{trial}.mcap",
            "<raw>/vicon/{trial}.c3d",
            "<raw>/truth/{trial}.json",
        wildcard_constraints:
            trial=name_pattern(CAMPAIGN.trials("walking")),
        priority: 0
