"""Trial -> the tables of its fit, for every experiment whose facts name a job (`osl_analysis/config/experiments.py`).

What uses the results of every trial depends on one list per experiment: Snakemake's planning takes time with every file
that a rule names. A rule names one file of every job that it needs; what else that job has made is `read`.
"""


def device(trial: str):
    """The parameter file of a trial's device; none where there is none for its joint."""
    return CAMPAIGN.device(trial) or []


def fit_file(experiment: str, table: str, trial: str) -> Path:
    """The file with a trial's rows of a table: of its own for the experiment's first table, one archive for the others."""
    first = EXPERIMENTS[experiment].tables[0].name
    return RESULTS / f"fits/{first}/{trial}{'.csv' if table == first else '.zip'}"


def fit_files(experiment: str, trial: str) -> list[Path]:
    """The files that the fit of a trial writes."""
    return list(dict.fromkeys(fit_file(experiment, table.name, trial) for table in EXPERIMENTS[experiment].tables))


def fit_tables(experiment: str, trial: str) -> dict[str, Path]:
    """Where the fit of a trial writes each of its tables."""
    files = {table.name: fit_file(experiment, table.name, trial) for table in EXPERIMENTS[experiment].tables}
    return {name: file / f"{name}.csv" if file.suffix == ".zip" else file for name, file in files.items()}


def condition(trial: str, columns) -> dict[str, object]:
    """What the sheet states for a trial in these columns, as a setting of its fit."""
    return {"condition": {column: CAMPAIGN.row(trial)[column] for column in columns}} if columns else {}


for experiment, facts in EXPERIMENTS.items():
    if not facts.fit:
        continue

    @step(
        facts.fit.job,
        fit_files(experiment, "{trial}"),
        f"{experiment}/{{trial}}",
        name=f"fit_{experiment}_trial",
    )
    def fit_trial(wildcards, experiment=experiment, fit=facts.fit):
        trial = wildcards.trial
        settings = {name: getattr(CONFIG, section).part(model) for name, (section, model) in fit.settings.items()}
        settings |= condition(trial, fit.sheet)
        return {
            "input": {"trial": trial_file(trial)},
            "files": {"parameters": device(trial)} if fit.parameters else {},
            "settings": settings | ({"windows": CAMPAIGN.row(trial)["windows"]} if fit.windows else {}),
            "output": {"tables": fit_tables(experiment, trial)},
        }


def fitted(*experiments: str) -> list[Path]:
    """The lists of the trials that were fitted, of these experiments."""
    return [RESULTS / f"fits/{name}.json" for name in experiments if CAMPAIGN.trials(name) and EXPERIMENTS[name].tables]


@step(
    "tables.list_fits",
    RESULTS / "fits/{experiment}.json",
    "fits/{experiment}",
    experiment="|".join(name for name, facts in EXPERIMENTS.items() if facts.tables),
)
def list_fits(wildcards):
    return {"input": {"fits": first_rows(wildcards.experiment)}}
