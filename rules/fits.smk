"""Trial -> the tables of its fit, for every experiment whose facts name a job (`osl_analysis/experiments.py`).

What uses the results of every trial depends on one list per experiment: Snakemake's planning takes time with every file
that a rule names. A rule names one file of every job that it needs; what else that job has made is `read`.
"""


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


def fitted(*experiments: str) -> list[Path]:
    """The lists of the trials that were fitted, of these experiments."""
    return [RESULTS / f"fits/{name}.json" for name in experiments if CAMPAIGN.trials(name) and CONFIG.tables(name)]


rule list_fits:
    input:
        fits=lambda wildcards: first_rows(wildcards.experiment),
    output:
        RESULTS / "fits/{experiment}.json",
    log:
        RESULTS / "logs/fits/{experiment}.log",
    wildcard_constraints:
        experiment="|".join(name for name, facts in EXPERIMENTS.items() if facts.tables),
    params:
        code=jobs.code_of("tables.list_fits"),
    run:
        jobs.run_job(log, "tables.list_fits", input, output, params)
