"""`snakemake study`: the Monte Carlo study of bias, efficiency and coverage of the estimators."""

STUDY = CONFIG.study
STUDIED = (
    "second order",
    "linear drivetrain",
    "drivetrain",
    "frequency response",
    "transmission",
    "repeated transmission",
    "belt",
    "repeated belt",
    "actuator",
    "walking",
    "walking recorded",
)
COUNTS = {"walking": (STUDY.campaigns, 10), "walking recorded": (STUDY.recorded, 5)}
"""Campaigns of walking, and how many of them a job takes."""


def batches() -> list[Path]:
    """The estimates of every job of the study."""
    files = []
    for experiment in STUDIED:
        total, size = COUNTS.get(experiment, (STUDY.trials, STUDY.batch))
        files += [
            RESULTS / f"study/batches/{experiment.replace(' ', '_')}_{first}_{min(size, total - first)}.csv"
            for first in range(0, total, size)
        ]
    return files


rule study_batch:
    input:
        settings=settings_files(STUDY.simulation),
    output:
        RESULTS / "study/batches/{experiment}_{start}_{number}.csv",
    log:
        RESULTS / "logs/study/{experiment}_{start}_{number}.log",
    wildcard_constraints:
        experiment="|".join(name.replace(" ", "_") for name in STUDIED),
        start="[0-9]+",
        number="[0-9]+",
    params:
        code=jobs.code("commands.study"),
        study=STUDY.model_dump(mode="json", exclude={"trials", "campaigns", "recorded"}),
        settings=DYNAMOMETER,
        actuator=CONFIG.actuator.model_dump(mode="json"),
        walking=WALKING,
    run:
        jobs.run_job(
            log[0],
            "study.run_batch",
            experiment=wildcards.experiment.replace("_", " "),
            first=int(wildcards.start),
            count=int(wildcards.number),
            study=STUDY,
            dynamometer=dynamometer_settings(params),
            actuator_analysis=ActuatorAnalysis.model_validate(params.actuator),
            walking=WalkingAnalysis.model_validate(params.walking),
            sources=CONFIG.sources,
            output=Path(output[0]),
        )


rule study_table:
    input:
        batches=batches(),
    output:
        RESULTS / "study/study.csv",
    log:
        RESULTS / "logs/study/table.log",
    params:
        code=jobs.code("commands.study"),
    run:
        jobs.run_job(log[0], "study.summarise", batches=[Path(p) for p in input.batches], output=Path(output[0]))


rule study_figure:
    input:
        RESULTS / "study/study.csv",
    output:
        expand(RESULTS / "study/study.{suffix}", suffix=SUFFIXES),
    log:
        RESULTS / "logs/study/figure.log",
    params:
        code=jobs.code("figures.study"),
    run:
        jobs.run_job(
            log[0],
            "figure.draw_figure",
            name="study",
            table_csv=Path(input[0]),
            outputs=[Path(p) for p in output],
        )


rule study:
    input:
        RESULTS / "study/study.csv",
        expand(RESULTS / "study/study.{suffix}", suffix=SUFFIXES),
