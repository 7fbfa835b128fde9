"""Trial -> the tables of its fit, for every experiment whose facts name a job (`osl_analysis/experiments.py`).

What uses the results of every trial depends on one list per experiment: Snakemake's planning takes time with every file
that a rule names. A rule names one file of every job that it needs; what else that job has made is `read`.
"""


def device(trials):
    """The parameter file of a trial's device, as an input of its rule; none where there is none for its joint."""
    files = {CAMPAIGN.device(trial) for trial in trials}
    return (files.pop() or []) if len(files) == 1 else lambda wildcards: CAMPAIGN.device(wildcards.trial) or []


def stated(experiment: str, columns, windows: bool):
    """What the sheet states for a trial, as a parameter of its rule: its `condition` in these columns, its windows."""

    def of_trial(wildcards) -> dict[str, object]:
        row = CAMPAIGN.row(wildcards.trial, experiment)
        condition = {"condition": {column: row[column] for column in columns}} if columns else {}
        return condition | ({"windows": row["windows"]} if windows else {})

    return of_trial


def fit_file(experiment: str, table: str, trial: str) -> Path:
    """The file with a trial's rows of a table: of its own for the experiment's first table, one archive for the others."""
    first = CONFIG.tables(experiment)[0].name
    return RESULTS / f"fits/{first}/{trial}{'.csv' if table == first else '.zip'}"


def fit_files(experiment: str, trial: str) -> list[Path]:
    """The files that the fit of a trial writes."""
    return list(dict.fromkeys(fit_file(experiment, table.name, trial) for table in CONFIG.tables(experiment)))


def fit_tables(experiment: str, trial: str) -> dict[str, Path]:
    """Where the fit of a trial writes each of its tables."""
    files = {table.name: fit_file(experiment, table.name, trial) for table in CONFIG.tables(experiment)}
    return {name: file / f"{name}.csv" if file.suffix == ".zip" else file for name, file in files.items()}


for experiment, facts in EXPERIMENTS.items():
    if not facts.fit:
        continue

    rule:
        name:
            f"fit_{experiment}_trial"
        input:
            **({"parameters": device(CAMPAIGN.trials(experiment))} if facts.fit.parameters else {}),
            trial=RESULTS / "trials/{trial}.parquet",
        output:
            fit_files(experiment, "{trial}"),
        log:
            RESULTS / f"logs/{experiment}/{{trial}}.log",
        group:
            "trials"
        params:
            **{name: getattr(CONFIG, section).part(model) for name, (section, model) in facts.fit.settings.items()},
            of_trial=stated(experiment, facts.fit.sheet, facts.fit.windows),
            command=facts.fit.job,
            code=jobs.code_of(facts.fit.job),
        run:
            tables = fit_tables(CAMPAIGN.row(wildcards.trial)["experiment"], wildcards.trial)
            jobs.run_job(log, params.command, input, {"tables": tables}, params, files=output)


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
