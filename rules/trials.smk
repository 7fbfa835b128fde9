"""Raw log, which may be simulated -> trial and what quality control measures on it -> the tables of its fit.

Planning takes time with every file that a rule names. It names one file of every job that it needs, what else that job
has made is `read`; what uses the results of every trial names one list per experiment.
"""


def trial_file(trial: str) -> Path:
    """The file of one ingested trial."""
    return RESULTS / f"trials/{trial}.parquet"


def checked(trials) -> list[Path]:
    """The quality measures of these trials, without verdicts. The job's input `quality` leaves excluded ones out."""
    return [RESULTS / f"quality/{trial}.csv" for trial in trials]


if CONFIG.simulation:
    planned_by = {"files": {"settings_path": CONFIG.simulation}}
    single(
        "simulate.write_sheet", {"sheet": CONFIG.sheet}, "simulate/sheet", planned_by, "trial_sheet"
    )
    for experiment in filter(CAMPAIGN.trials, EXPERIMENTS):
        logs = [RAW / path for path in EXPERIMENTS[experiment].simulated_files("{trial}").values()]
        of_trials = {"name": f"simulate_{experiment}", "trial": CAMPAIGN.pattern(experiment)}

        @step("simulate.simulate_trial", logs, "simulate/{trial}", **of_trials)
        def simulate_trial(wildcards, experiment=experiment):
            settings = {
                "settings_path": CONFIG.simulation,
                "campaign_folder": RAW,
                "trial": wildcards.trial,
            }
            settings["followed"] = CONFIG.shared(experiment).model_dump(mode="json")
            return {"made_of": SIMULATION_FILES, "settings": settings, "output": {}}


@step(
    "trials.ingest_and_check",
    {"trial": trial_file("{trial}"), "quality": checked(["{trial}"])[0]},
    "ingest/{trial}",
)
def ingest(wildcards):
    """A trial's simulated logs are needed, which other jobs write. Real recordings are no inputs: see `recordings`."""
    trial, commanded = wildcards.trial, {"amplitudes_deg": [], "frequencies_hz": [], "cycles": 1}
    if EXPERIMENTS[CAMPAIGN.row(trial)["experiment"]].stepped_sine:
        commanded = {name: setting("dynamometer")[name] for name in PROTOCOL}
    settings = {
        "row": CAMPAIGN.recording(trial),
        "raw_folder": RAW,
        "sources_folder": CONFIG.sources,
    }
    settings |= {"needed_columns": CAMPAIGN.needed_columns(trial), "commanded": commanded}
    logs = {"needs" if CONFIG.simulation else "recordings": CAMPAIGN.logs(trial)}
    return {**logs, "made_of": CAMPAIGN.sources(trial), "settings": settings}


VERDICTS = {"input": {"rows": checked(CAMPAIGN.trials())}}
VERDICTS["settings"] = {"rules": setting("quality"), "accept": JUDGE.accept, "places": PLACES}
single("tables.judge", tabled("quality"), "tables/quality", VERDICTS)


def fit_file(experiment: str, table: str, trial: str) -> Path:
    """The file with a trial's rows of a table: of its own for the experiment's first table and for the samples of its
    record, one archive for the others."""
    first = EXPERIMENTS[experiment].tables[0].name
    return (
        RESULTS / f"fits/{first}/{trial}{ {first: '.csv', 'record': '.parquet'}.get(table, '.zip')}"
    )


def condition(trial: str, columns) -> dict[str, object]:
    """What the sheet states for a trial in these columns, as a setting of its fit."""
    return (
        {"condition": {column: CAMPAIGN.row(trial)[column] for column in columns}}
        if columns
        else {}
    )


for experiment, facts in EXPERIMENTS.items():
    if not facts.fit:
        continue
    files = list(
        dict.fromkeys(fit_file(experiment, table.name, "{trial}") for table in facts.tables)
    )

    @step(facts.fit.job, files, f"{experiment}/{{trial}}", name=f"fit_{experiment}_trial")
    def fit_trial(wildcards, experiment=experiment, facts=facts):
        trial, fit = wildcards.trial, facts.fit
        places = {table.name: fit_file(experiment, table.name, trial) for table in facts.tables}
        settings = {
            name: getattr(CONFIG, section).part(model)
            for name, (section, model) in fit.settings.items()
        }
        settings |= condition(trial, fit.sheet) | (
            {"windows": CAMPAIGN.row(trial)["windows"]} if fit.windows else {}
        )
        files = {"parameters": CAMPAIGN.device(trial) or []} if fit.parameters else {}
        tables = {
            name: file / f"{name}.csv" if file.suffix == ".zip" else file
            for name, file in places.items()
        }
        parts = {"input": {"trial": trial_file(trial)}, "files": files, "settings": settings}
        return parts | {"output": {"tables": tables}}


FITTED = [name for name, facts in EXPERIMENTS.items() if facts.tables]


def fitted(*experiments: str) -> list[Path]:
    """The lists of the trials that were fitted, of these experiments."""
    return [
        RESULTS / f"fits/{name}.json"
        for name in experiments
        if name in FITTED and CAMPAIGN.trials(name)
    ]


@step("tables.list_fits", "fits/{experiment}.json", experiment="|".join(FITTED))
def list_fits(wildcards):
    table = EXPERIMENTS[wildcards.experiment].tables[0]
    return {"input": {"fits": rows(table.name, CAMPAIGN.rows_of(wildcards.experiment, table))}}
