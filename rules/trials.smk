"""Raw log -> trial and what the checks of quality control measure on it, in one job; the verdicts on all trials."""


def ingested(*experiments: str) -> list[Path]:
    """The trials of these experiments, or of all."""
    return [trial_file(trial) for trial in CAMPAIGN.trials(*experiments)]


def trial_file(trial: str) -> Path:
    """The file of one ingested trial."""
    return RESULTS / f"trials/{trial}.parquet"


def checked(trials) -> list[Path]:
    """What was measured on these trials, without verdicts: in a job the input `quality` leaves the excluded ones out."""
    return [RESULTS / f"quality/{trial}.csv" for trial in trials]


@step(
    "trials.ingest_and_check",
    {"trial": RESULTS / "trials/{trial}.parquet", "quality": RESULTS / "quality/{trial}.csv"},
    "ingest/{trial}",
)
def ingest(wildcards):
    """A trial's simulated logs are needed, which other jobs write. Real recordings are no inputs: see `recordings`."""
    trial, simulated = wildcards.trial, CONFIG.simulation is not None
    return {
        "needs": CAMPAIGN.logs(trial) if simulated else [],
        "recordings": [] if simulated else CAMPAIGN.logs(trial),
        "made_of": CAMPAIGN.sources(trial),
        "settings": {
            "row": CAMPAIGN.recording(trial),
            "needed_columns": EXPERIMENTS[CAMPAIGN.row(trial)["experiment"]].needed_columns,
            "raw_folder": str(RAW),
            "sources_folder": str(CONFIG.sources),
            "commanded": CONFIG.dynamometer.model_dump(mode="json", include=set(PROTOCOL)),
        },
    }


@step("tables.judge", tabled("quality"), "tables/quality")
def judge(_):
    rules_of_quality = CONFIG.quality.model_dump(mode="json")
    return {
        "input": {"rows": checked(CAMPAIGN.trials())},
        "settings": {"rules": rules_of_quality, "accept": JUDGE.accept, "places": PLACES},
    }


@step("tables.list_excluded", tabled("excluded"), "tables/excluded")
def excluded_trials(_):
    return {
        "input": {"verdicts": tabled("quality")},
        "after": every_end(),
        "read": {"fitted": all_rows()},
        "settings": {"by_sheet": dict(CAMPAIGN.excluded), "places": PLACES},
    }
