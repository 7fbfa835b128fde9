"""Trial -> the tables of its fit, for every experiment whose facts name a job (`osl_analysis/experiments.py`)."""


def device(trial: str):
    """The parameter file of a trial's device, as an input; none where there is none for its joint."""
    return CAMPAIGN.device(trial) or []


def sheet_row(*columns: str):
    """These columns of a trial's row, as a parameter of its rule."""
    return lambda wildcards: {column: CAMPAIGN.row(wildcards.trial)[column] for column in columns}


def stated_windows(wildcards) -> str | None:
    """The windows that the sheet states for a trial."""
    return CAMPAIGN.row(wildcards.trial)["windows"]


for experiment, facts in EXPERIMENTS.items():
    if not facts.fit:
        continue

    rule:
        name:
            f"fit_{experiment}_trial"
        input:
            **({"parameters": lambda wildcards: device(wildcards.trial)} if facts.fit.parameters else {}),
            trial=RESULTS / "trials/{trial}.parquet",
        output:
            **{table.name: RESULTS / f"fits/{table.name}/{{trial}}.csv" for table in CONFIG.tables(experiment)},
        log:
            RESULTS / f"logs/{experiment}/{{trial}}.log",
        wildcard_constraints:
            trial=CAMPAIGN.pattern(experiment),
        group:
            "trials"
        params:
            **{name: getattr(CONFIG, section).part(model) for name, (section, model) in facts.fit.settings.items()},
            **({"condition": sheet_row(*facts.fit.sheet)} if facts.fit.sheet else {}),
            **({"windows": stated_windows} if facts.fit.windows else {}),
            command=facts.fit.job,
            code=jobs.code_of(facts.fit.job),
        run:
            jobs.run_job(log, params.command, input, {"tables": dict(output.items())}, params)
