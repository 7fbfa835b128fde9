"""Raw log -> canonical trial."""


def ingested(*experiments: str) -> list[Path]:
    """The canonical trials of these experiments, or of all."""
    return [RESULTS / f"trials/{trial}.parquet" for trial in CAMPAIGN.trials(*experiments)]


def raw_files(wildcards) -> list[Path]:
    """A trial's logs and source files. One that a laboratory forgot is left to the job, which names it and fails alone."""
    files = [*CAMPAIGN.logs(wildcards.trial), *CAMPAIGN.sources(wildcards.trial)]
    return [path for path in files if CONFIG.simulation or path.exists()]


rule ingest:
    input:
        raw_files,
    output:
        RESULTS / "trials/{trial}.parquet",
    log:
        RESULTS / "logs/ingest/{trial}.log",
    params:
        code=jobs.code("commands.ingest"),
        row=lambda wildcards: CAMPAIGN.recording(wildcards.trial),
    run:
        jobs.run_job(
            log[0],
            "ingest.ingest_trial",
            row=params.row,
            raw_folder=CONFIG.raw_data,
            sources_folder=CONFIG.sources,
            output=Path(output[0]),
        )
