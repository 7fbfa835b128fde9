"""Fits of single trials -> tidy tables over trials -> the headline numbers."""

TABLES = [(name, table) for name in EXPERIMENTS for table in EXPERIMENTS[name].tables]
FITTED = {(name, table.name) for name, table in TABLES}
PER_TRIAL = {
    table.name: [trial for name, one in TABLES if one.name == table.name for trial in CAMPAIGN.rows_of(name, one)]
    for _, table in TABLES
} | {
    "model_comparison": COMPARISONS,
    "quality": CAMPAIGN.trials(),
    "hinge": list(CALIBRATED),
}
"""Per table, the trials (or comparisons) that have rows in it. `hinge` has the static trials."""
DOUBTS_OF = {table.name: table.doubts_of for _, table in TABLES if table.doubts_of}
"""Per table, the table of the same trials whose doubts its rows share."""
UNPUBLISHED = {table.name for name, table in TABLES if not table.published}
DERIVED = {new: (table.name, job) for name, table in TABLES for new, job in table.derived.items()} | {
    "model_comparison_summary": ("model_comparison", "bench.summarise_model_comparison")
}
"""Per table that is computed from one other table: that table, and the job."""


def row_file(table: str, trial: str) -> Path:
    """The file with the rows of a trial, or of a comparison, behind a table."""
    experiment = CAMPAIGN.rows[trial]["experiment"] if trial in CAMPAIGN.rows else ""
    if (experiment, table) in FITTED:
        return fit_file(experiment, table, trial)
    return RESULTS / ("quality" if table == "quality" else f"fits/{table}") / f"{trial}.csv"


def rows(table: str, trials=None) -> list[Path]:
    """The files of single trials, or of these trials, behind a table."""
    return [row_file(table, trial) for trial in (PER_TRIAL[table] if trials is None else trials)]


def first_rows(experiment: str) -> list[Path]:
    """One file of the results of each trial of an experiment."""
    table = EXPERIMENTS[experiment].tables[0]
    return rows(table.name, CAMPAIGN.rows_of(experiment, table))


def behind(table: str) -> list[Path]:
    """What was made when all single trials' results behind a table were: the lists of its experiments, or the results
    themselves.
    """
    experiments = [name for name, one in TABLES if one.name == table]
    return fitted(*experiments) if experiments else rows(table)


def verdicts_on(table: str) -> list[Path]:
    """The verdicts on the trials of a table; the table of the verdicts itself has all trials."""
    return checked(name for name in PER_TRIAL[table] if name in CAMPAIGN.rows and table != "quality")


def by_stem(files) -> dict[str, str]:
    """These files by their names without suffix."""
    return {Path(file).stem: str(file) for file in files}


def result_tables() -> list[Path]:
    """Every table of results that the campaign's experiments give."""
    tables = [table for table, trials in PER_TRIAL.items() if trials and table not in {"quality", *UNPUBLISHED}]
    tables += [table for table, (source, _) in DERIVED.items() if source in tables]
    tables += [table for name in EXPERIMENTS if CAMPAIGN.trials(name) for table in EXPERIMENTS[name].further_tables]
    tables += ["gains"] * bool(CONFIG.impedance_trajectory)
    return [tabled(table) for table in tables]


def written_tables() -> list[str]:
    """Every table that this run writes for the reader, below the results' folder."""
    published = [*result_tables(), tabled("quality"), tabled("excluded"), *drawn_files()]
    return [str(path.relative_to(RESULTS)) for path in published if path.suffix == ".csv"]


def example():
    """The desired impedance of Fig. 4, whose estimates are headline numbers; None without impedance trials."""
    if TIME_SERIES is None:
        return None
    row = CAMPAIGN.row(TIME_SERIES.trial)
    return {"K_d": row["K_d"], "B_d": row["B_d"], "chosen": TIME_SERIES.chosen}


def limits_of(table: str):
    """The limits beyond which a fit of a table is doubtful; None for a table that is not judged."""
    return CONFIG.doubtful.of(table).model_dump(mode="json") if table in judged_tables() else None


def all_rows() -> list[Path]:
    """The results of single trials, of every kind."""
    return [*crossings(CAMPAIGN.trials("walking")), *(path for table in PER_TRIAL for path in rows(table))]


def every_end() -> list[Path]:
    """What was made when the results of single trials of every kind were."""
    tables = [table for table in ("model_comparison", "hinge") if PER_TRIAL[table]]
    tables += ["walking_crossings"] * bool(CAMPAIGN.trials("walking"))
    return [*fitted(*EXPERIMENTS), *map(tabled, tables)]


def rows_behind(table: str) -> list[Path]:
    """The results of single trials that a table, which may be derived from others, is made of."""
    if table in EXPERIMENTS["walking"].further_tables:
        return [*crossings(CAMPAIGN.trials("walking")), *rows("walking")]
    source = DERIVED.get(table, (table,))[0]
    return rows(source) if source in PER_TRIAL else []


@step("tables.gather", tabled("{table}"), "tables/{table}", table="|".join(PER_TRIAL.keys() - {"quality"}))
def table(wildcards):
    of, judged = wildcards.table, DOUBTS_OF.get(wildcards.table, "")
    fits = {"fits": rows(judged)} if judged else {}
    return {
        "after": behind(of),
        "read": {"rows": rows(of), "quality": verdicts_on(of), **fits},
        "settings": {"limits": limits_of(of), "limits_of_fits": limits_of(judged), "places": PLACES},
    }


@step("", tabled("{derived}"), "tables/{derived}", derived="|".join(DERIVED))
def derived_table(wildcards):
    source, command = DERIVED[wildcards.derived]
    return {"command": command, "input": {"table": tabled(source)}}


POOLED = ("response_pooled", "response_models_pooled")


@step("tables.pool_responses", {name: tabled(name) for name in POOLED}, "tables/response_pooled")
def pool_responses(_):
    return {
        "files": {"parameters": CONFIG.parameters or []},
        "after": behind("response_lines") if "response_lines" in PER_TRIAL else [],
        "read": {"lines": rows("response_lines"), "quality": verdicts_on("response_lines")},
        "settings": {
            "conditions": {trial: CAMPAIGN.row(trial) for trial in PER_TRIAL["response_lines"]},
            "settings": CONFIG.dynamometer.part("FilterSettings"),
        },
    }


@step("gains.select_trajectory", tabled("gains"), "tables/gains")
def gains_table(_):
    return {
        "files": {"trajectory": CONFIG.impedance_trajectory or [], "parameters": CONFIG.parameters or []},
        "settings": {"weight": CONFIG.gain_weight.model_dump(mode="json")},
    }


SUMMARY = {"summary_json": RESULTS / "summary.json", "numbers_tex": RESULTS / "numbers.tex"}


@step("tables.write_summary", SUMMARY, "summary")
def headline_numbers(_):
    return {
        "input": {"excluded": tabled("excluded"), "verdicts": tabled("quality")},
        "after": result_tables(),
        "read": {"table_paths": by_stem(result_tables())},
        "settings": {
            "about": asdict(ABOUT),
            "example": example(),
            "trials": {name: CAMPAIGN.trials(name) for name in EXPERIMENTS if CAMPAIGN.trials(name)},
        },
    }


@step("tables.write_table_metadata", RESULTS / "csv-metadata.json", "csv_metadata")
def describe_tables(_):
    return {"settings": {"about": asdict(ABOUT), "tables": written_tables()}}
