# SPDX-License-Identifier: Apache-2.0
"""Ankle impedance of a walking person, from perturbed and unperturbed crossings (Fig. 9)."""

from osl_analysis.commands.walking import (
    StatedOfCrossing,
    analyse,
    average_unperturbed,
    calibrate,
    find_timing,
    fit_perturbation,
    identify_plate,
    select_crossings,
)
from osl_analysis.commands.walking_summary import (
    SummaryFiles,
    SummaryOutputs,
    summarise_perturbations,
    tabulate_groups,
)
from osl_analysis.walking.walking_settings import (
    CalibrationSettings,
    CrossingSettings,
    PlateModelSettings,
    SelectionSettings,
    TimingSettings,
)

WALKED = {trial: PLACES[trial] for trial in CAMPAIGN.trials("walking")}
"""Joint and side of every crossing."""
PERTURBED = CAMPAIGN.crossings(perturbed=True)
UNPERTURBED = CAMPAIGN.crossings(perturbed=False)
PLATE_TRIALS = CAMPAIGN.plate_trials()


rule calibrate_markers:
    """Marker clusters, ankle centre and axis of a static trial."""
    input:
        lambda wildcards: FILES.checks([wildcards.trial]),
        trial=of_trials(CAMPAIGN.static_of.values()),
    output:
        output="<results>/fits/calibration/{trial}.json",
    log:
        "<logs>/markers/{trial}.log",
    localrule: True
    params:
        settings=lambda wildcards: {
            **CONFIG.walking.part(CalibrationSettings),
            "side": PLACES[wildcards.trial]["side"],
        },
        body_mass_kg=cell("body_mass_kg"),
        excluded=lambda wildcards: excluded([wildcards.trial]),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            calibrate,
            output,
            log,
            inputs=dict(trial=input.trial),
            arguments=dict(
                settings=CalibrationSettings(**params.settings),
                body_mass_kg=params.body_mass_kg,
                output=Path(output.output),
            ),
            left_out=LeftOut(excluded=params.excluded),
            trial=TrialFiles(wildcards.trial, [Path(input.trial)]),
        )


rule identify_plate:
    """Inertia and lag of the force plate, from trials of the unloaded plate."""
    input:
        FILES.checks(PLATE_TRIALS),
        trials=expand("<results>/trials/{trial}.parquet", trial=PLATE_TRIALS),
        calibrations=FILES.calibrations(PLATE_TRIALS),
    output:
        output="<results>/fits/plate.json",
    log:
        "<logs>/identify_plate.log",
    localrule: True
    params:
        statics={trial: CAMPAIGN.static_of[trial] for trial in PLATE_TRIALS},
        settings=CONFIG.walking.part(PlateModelSettings),
        excluded=lambda wildcards: excluded(PLATE_TRIALS),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            identify_plate,
            output,
            log,
            inputs=dict(trials=input.trials, calibrations=input.calibrations),
            arguments=dict(
                statics=params.statics,
                settings=PlateModelSettings(**params.settings),
                output=Path(output.output),
            ),
            left_out=LeftOut(excluded=params.excluded),
        )


rule find_timing:
    """Onsets of all perturbed crossings, by the mean ramp of the platform, and the plate's lag."""
    input:
        FILES.checks(PERTURBED),
        trials=expand("<results>/trials/{trial}.parquet", trial=PERTURBED),
        calibrations=FILES.calibrations(PERTURBED),
        plate="<results>/fits/plate.json",
    output:
        output="<results>/fits/timing.json",
    log:
        "<logs>/find_timing.log",
    localrule: True
    params:
        statics={trial: CAMPAIGN.static_of[trial] for trial in PERTURBED},
        settings=CONFIG.walking.part(CrossingSettings),
        excluded=lambda wildcards: excluded(PERTURBED),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            find_timing,
            output,
            log,
            inputs=dict(
                trials=input.trials, calibrations=input.calibrations, plate=input.plate
            ),
            arguments=dict(
                statics=params.statics,
                settings=CrossingSettings(**params.settings),
                output=Path(output.output),
            ),
            left_out=LeftOut(excluded=params.excluded),
        )


rule analyse_crossing:
    """Ankle angle and torque over the stance of one crossing."""
    input:
        trial=of_trials(WALKED),
        calibration=lambda wildcards: FILES.calibrations([wildcards.trial])[0],
        plate="<results>/fits/plate.json",
        timing="<results>/fits/timing.json",
    output:
        output="<results>/crossings/{trial}.parquet",
    log:
        "<logs>/crossings/{trial}.log",
    params:
        settings=CONFIG.walking.part(CrossingSettings),
        perturbed=cell("perturbed"),
        direction=cell("direction"),
        body_mass_kg=cell("body_mass_kg"),
        made_by=MADE_BY,
    run:
        job(
            analyse,
            output,
            log,
            inputs=dict(
                trial=input.trial,
                calibration=input.calibration,
                plate=input.plate,
                timing=input.timing,
            ),
            arguments=dict(
                settings=CrossingSettings(**params.settings),
                sheet_cells=StatedOfCrossing(
                    perturbed=params.perturbed,
                    direction=params.direction,
                    body_mass_kg=params.body_mass_kg,
                ),
                output=Path(output.output),
            ),
            trial=TrialFiles(wildcards.trial, [Path(input.trial)]),
        )


rule select_crossings:
    """Whether each crossing is used, with the reason if it is not."""
    input:
        FILES.checks(WALKED),
        crossings=FILES.crossings(WALKED),
    output:
        output="<results>/tables/walking_crossings.csv",
    log:
        "<logs>/walking/selection.log",
    localrule: True
    params:
        settings=CONFIG.walking.part(SelectionSettings),
        sheet=CAMPAIGN.conditions(),
        places=WALKED,
        excluded=lambda wildcards: excluded(WALKED),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            select_crossings,
            output,
            log,
            inputs=dict(crossings=input.crossings),
            arguments=dict(
                settings=SelectionSettings(**params.settings),
                sheet=params.sheet,
                places=params.places,
                data=CAMPAIGN.data,
                output=Path(output.output),
            ),
            left_out=LeftOut(excluded=params.excluded),
        )


rule average_unperturbed:
    """The mean unperturbed gait of each group of crossings."""
    input:
        FILES.checks(UNPERTURBED),
        crossings=FILES.crossings(UNPERTURBED),
        selection="<results>/tables/walking_crossings.csv",
    output:
        output="<results>/fits/unperturbed.json",
    log:
        "<logs>/walking/unperturbed.log",
    localrule: True
    params:
        fewest=CONFIG.walking.fewest_unperturbed,
        excluded=lambda wildcards: excluded(UNPERTURBED),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            average_unperturbed,
            output,
            log,
            inputs=dict(crossings=input.crossings, selection=input.selection),
            arguments=dict(fewest=params.fewest, output=Path(output.output)),
            left_out=LeftOut(excluded=params.excluded),
        )


rule fit_perturbation:
    """K, B, I of one perturbed crossing."""
    input:
        crossing=of_trials(PERTURBED, "<results>/crossings/{trial}.parquet".format),
        selection="<results>/tables/walking_crossings.csv",
        unperturbed="<results>/fits/unperturbed.json",
    output:
        output="<results>/fits/walking/{trial}.csv",
    log:
        "<logs>/walking/{trial}.log",
    params:
        settings=CONFIG.walking.part(TimingSettings),
        made_by=MADE_BY,
    run:
        job(
            fit_perturbation,
            output,
            log,
            inputs=dict(
                crossing=input.crossing,
                selection=input.selection,
                unperturbed=input.unperturbed,
            ),
            arguments=dict(
                settings=TimingSettings(**params.settings),
                data=CAMPAIGN.data,
                output=Path(output.output),
            ),
            trial=TrialFiles(wildcards.trial, [Path(input.crossing)]),
        )


rule summarise_walking:
    """K, B, I of each group of perturbations, and their responses."""
    input:
        FILES.checks(PERTURBED),
        table="<results>/tables/walking.csv",
        crossings=FILES.crossings(PERTURBED),
        selection="<results>/tables/walking_crossings.csv",
        unperturbed="<results>/fits/unperturbed.json",
        plate="<results>/fits/plate.json",
        timing="<results>/fits/timing.json",
        trajectory=TRAJECTORY,
    output:
        summary="<results>/fits/walking_summary.csv",
        responses="<results>/tables/walking_responses.csv",
        groups="<results>/fits/walking_groups.csv",
        budget="<results>/tables/walking_budget.csv",
    log:
        "<logs>/walking/summary.log",
    localrule: True
    params:
        settings=CONFIG.walking.part(TimingSettings),
        sheet=CAMPAIGN.conditions(),
        places=WALKED,
        has_drivetrain=bool(CONFIG.parameters),
        excluded=lambda wildcards: excluded(PERTURBED),
        made_by=MADE_BY,
    message:
        WITHOUT_EXCLUDED
    run:
        job(
            summarise_perturbations,
            output,
            log,
            inputs=dict(
                files=SummaryFiles(
                    table=input.table,
                    crossings=input.crossings,
                    selection=input.selection,
                    unperturbed=input.unperturbed,
                    plate=input.plate,
                    timing=input.timing,
                    trajectory=input.trajectory,
                ),
            ),
            arguments=dict(
                settings=TimingSettings(**params.settings),
                sheet=params.sheet,
                places=params.places,
                has_drivetrain=params.has_drivetrain,
                outputs=SummaryOutputs(
                    summary=Path(output.summary),
                    responses=Path(output.responses),
                    groups=Path(output.groups),
                    budget=Path(output.budget),
                    data=CAMPAIGN.data,
                ),
            ),
            left_out=LeftOut(excluded=params.excluded),
        )


rule walking_table:
    """K, B, I of each group with the findings on it (Fig. 9)."""
    input:
        summary="<results>/fits/walking_summary.csv",
        fits="<results>/tables/walking.csv",
        findings=FILES.findings("walking", GROUPS),
    output:
        output="<results>/tables/walking_summary.csv",
    log:
        "<logs>/walking/table.log",
    localrule: True
    params:
        made_by=MADE_BY,
    run:
        job(
            tabulate_groups,
            output,
            log,
            inputs=dict(summary=input.summary, fits=input.fits, findings=input.findings),
        )
