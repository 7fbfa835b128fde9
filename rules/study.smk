"""`snakemake validate`, or `study`: the Monte Carlo study of bias, efficiency and coverage of the estimators."""

STUDY = CONFIG.study
STUDIED = (
    {name: (STUDY.trials, STUDY.batch) for name in BENCH_EXPERIMENTS}
    | {name: (STUDY.campaigns, batch) for name, batch in STUDY_OF_REPEATS.items()}
    | {name: (getattr(STUDY, number), batch) for name, (number, batch) in WALKING_EXPERIMENTS.items()}
)
"""Trials or campaigns of each experiment, and how many of them one job takes at least."""
STUDIED_BY_FILE = {name.replace(",", "").replace(" ", "_"): name for name in STUDIED}


STUDY_JOBS = {
    f"{file}_{batch.first}_{batch.number}": batch
    for batch in study_batches(STUDIED)
    for file, name in STUDIED_BY_FILE.items()
    if name == batch.experiment
}
"""The jobs of the study by the names of their files."""


def study_files() -> list[Path]:
    """The files that decide what the study simulates."""
    from osl_analysis.commands.simulate import settings_files  # it loads the simulator

    return settings_files(STUDY.simulation)


def study_seconds(wildcards) -> float:
    """The expected time of a job of the study [s]; also of one that is not planned today."""
    return Batch(STUDIED_BY_FILE[wildcards.experiment], int(wildcards.first), int(wildcards.number)).seconds


def expected_time(planned_jobs) -> str:
    """What a dry run says of the jobs of the study."""
    studied = [job.wildcards for job in planned_jobs if job.rule.name.endswith("study_batch")]
    studied.sort(key=lambda one: (one.experiment, int(one.first)))
    return planned({f"{one.experiment}_{one.first}_{one.number}": study_seconds(one) for one in studied})


@step(
    "study.run_batch",
    RESULTS / "study/batches/{experiment}_{first}_{number}.csv",
    "study/{experiment}_{first}_{number}",
    experiment="|".join(STUDIED_BY_FILE),
    first="[0-9]+",
    number="[0-9]+",
)
def study_batch(wildcards):
    return {
        "modules": ("commands.study",),
        "made_of": study_files(),
        "settings": {
            "study": STUDY.model_dump(mode="json", exclude={"trials", "campaigns", "recorded"}),
            "dynamometer": CONFIG.dynamometer.model_dump(mode="json"),
            "actuator_analysis": CONFIG.actuator.model_dump(mode="json"),
            "walking": CONFIG.walking.model_dump(mode="json"),
            "sources": str(CONFIG.sources),
            "experiment": STUDIED_BY_FILE[wildcards.experiment],
            "first": wildcards.first,
            "number": wildcards.number,
        },
    }


@step("study.summarise", RESULTS / "study/study.csv", "study/table")
def study_table(_):
    return {"input": {"batches": [RESULTS / f"study/batches/{name}.csv" for name in STUDY_JOBS]}}


@step("study.write_page", RESULTS / "study/study.md", "study/page")
def study_page(_):
    return {"input": {"table": RESULTS / "study/study.csv"}}


@step("figure.draw_figure", [RESULTS / f"study/study.{suffix}" for suffix in SUFFIXES], "study/figure")
def study_figure(_):
    footer = f"Simulated data: Monte Carlo study with seed {STUDY.seed}, osl-analysis {ABOUT.version}"
    return {
        "modules": ("figures.names", "figures.others"),
        "input": {"table_csv": RESULTS / "study/study.csv"},
        "settings": {"name": "study", "footer": footer},
    }


rule study:
    input:
        rules.study_table.output,
        rules.study_page.output,
        rules.study_figure.output,


rule validate:
    input:
        rules.study.input,
