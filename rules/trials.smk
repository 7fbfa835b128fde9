"""Raw log -> trial and the verdict of quality control on it, in one job."""


def ingested(*experiments: str) -> list[Path]:
    """The trials of these experiments, or of all."""
    return [trial_file(trial) for trial in CAMPAIGN.trials(*experiments)]


def trial_file(trial: str) -> Path:
    """The file of one ingested trial."""
    return RESULTS / f"trials/{trial}.parquet"


def raw_files(wildcards) -> list[Path]:
    """A trial's simulated logs, which other jobs write. Real recordings are no inputs: see `recorded`."""
    return [*CAMPAIGN.logs(wildcards.trial), *CAMPAIGN.sources(wildcards.trial)]


def recorded(trial: str) -> dict[str, list | None]:
    """State of a trial's recordings; another size or date, older ones too, ingests it again.

    As inputs, Snakemake would ignore an older date, and stop the run for a file that it cannot read. The job names it.
    """
    return {} if CONFIG.simulation else {str(path): file_state(path) for path in CAMPAIGN.logs(trial)}


digest_of = cache(digest)  # many trials have the same source file


def described(trial: str) -> dict[str, str | None]:
    """Content of a trial's source files; another one ingests it again."""
    return {} if CONFIG.simulation else {str(path): digest_of(path) for path in CAMPAIGN.sources(trial)}


def ingest_of(wildcards) -> dict[str, object]:
    """What the ingest of a trial depends on beside settings."""
    return {
        "recorded": recorded(wildcards.trial),
        "described": described(wildcards.trial),
        "row": CAMPAIGN.recording(wildcards.trial),
        "needed_columns": EXPERIMENTS[CAMPAIGN.row(wildcards.trial)["experiment"]].needed_columns,
        "accept": CAMPAIGN.accepted(wildcards.trial),
    }


def checked(trials) -> list[Path]:
    """The verdicts of quality control on these trials."""
    return [RESULTS / f"quality/{trial}.csv" for trial in trials]


rule ingest:
    input:
        raw_files if CONFIG.simulation else [],
    output:
        trial=RESULTS / "trials/{trial}.parquet",
        quality=RESULTS / "quality/{trial}.csv",
    log:
        RESULTS / "logs/ingest/{trial}.log",
    group:
        "trials"
    params:
        code=jobs.code_of("trials.ingest_and_check"),
        of_trial=ingest_of,
        raw_folder=str(RAW),
        sources_folder=str(CONFIG.sources),
        rules=CONFIG.quality.model_dump(mode="json"),
        commanded=CONFIG.dynamometer.model_dump(mode="json", include=set(PROTOCOL)),
    run:
        jobs.run_job(log, "trials.ingest_and_check", input, output, params)


rule quality_table:
    input:
        rows=checked(CAMPAIGN.trials()),
    output:
        RESULTS / "tables/quality.csv",
    log:
        RESULTS / "logs/tables/quality.log",
    params:
        code=jobs.code_of("quality.tabulate"),
        places=PLACES,
    run:
        jobs.run_job(log, "quality.tabulate", input, output, params)


rule excluded_trials:
    input:
        verdicts=RESULTS / "tables/quality.csv",
        after=lambda wildcards: every_end(),
    output:
        RESULTS / "tables/excluded.csv",
    log:
        RESULTS / "logs/tables/excluded.log",
    params:
        code=jobs.code_of("quality.list_excluded"),
        by_sheet=dict(CAMPAIGN.excluded),
        places=PLACES,
    run:
        jobs.run_job(log, "quality.list_excluded", input, output, params, read={"fitted": all_rows()})
