"""Fits of single trials -> tidy tables over trials -> the headline numbers."""

KNOWN_GAINS, PARTS = CAMPAIGN.predicted(), ("actuator", "belt", "transmission")
MEASURED_AT = {part: [PLACES[trial] for trial in CAMPAIGN.trials(part)] for part in PARTS}
COMPONENTS = {
    trial: [part for part in PARTS if PLACES[trial] in MEASURED_AT[part]] for trial in KNOWN_GAINS
}
"""By impedance trial with known gains: the experiments that measured components of its joint and side."""
PREDICTED = [trial for trial, found in COMPONENTS.items() if len(found) == len(PARTS)]
MISSING = {
    trial: [part for part in PARTS if part not in found]
    for trial, found in COMPONENTS.items()
    if found
}
UNPREDICTED = {trial: " and ".join(parts) for trial, parts in MISSING.items() if parts}
"""By other trial: the components that were not measured; without trials for which none was."""
TABLES = [(name, table) for name in EXPERIMENTS for table in EXPERIMENTS[name].tables]
PER_TRIAL = {
    table.name: [
        trial
        for name, one in TABLES
        if one.name == table.name
        for trial in CAMPAIGN.rows_of(name, one)
    ]
    for _, table in TABLES
}
PER_TRIAL["quality"] = CAMPAIGN.trials()
"""By table: the trials that have rows in it."""
DERIVED = {new: (table.name, job) for name, table in TABLES for new, job in table.derived.items()}
"""By table that is computed from another one: that other table, and the job."""


def row_file(table: str, trial: str) -> Path:
    """The file with the rows of a trial behind a table."""
    experiment = CAMPAIGN.rows.get(trial, {}).get("experiment")
    if (experiment, table) in [(name, one.name) for name, one in TABLES]:
        return fit_file(experiment, table, trial)
    return RESULTS / ("quality" if table == "quality" else f"fits/{table}") / f"{trial}.csv"


def rows(table: str, trials=None) -> list[Path]:
    """The files of single trials, or of these trials, behind a table."""
    return [row_file(table, trial) for trial in (PER_TRIAL[table] if trials is None else trials)]


def behind(table: str) -> list[Path]:
    """The files that exist once all results behind a table do: lists of its experiments, or the results themselves."""
    lists = fitted(*(name for name, one in TABLES if one.name == table))
    return lists or rows(table)


def verdicts_on(table: str) -> list[Path]:
    """The verdicts on the trials of a table; the table of the verdicts itself has all trials."""
    return checked(
        name for name in PER_TRIAL[table] if name in CAMPAIGN.rows and table != "quality"
    )


def by_stem(files) -> dict[str, str]:
    """These files by their names without suffix."""
    return {Path(file).stem: str(file) for file in files}


def result_tables() -> list[Path]:
    """Every table of results that the campaign's experiments give."""
    unpublished = {"quality", *(table.name for _, table in TABLES if not table.published)}
    tables = [table for table, trials in PER_TRIAL.items() if trials and table not in unpublished]
    tables += [table for table, (source, _) in DERIVED.items() if source in tables]
    tables += CAMPAIGN.further_tables() + ["impedance_evidence"] * ("impedance" in tables)
    tables += ["gains"] * bool(CONFIG.impedance_trajectory)
    tables += ["prediction", "prediction_causes", "prediction_frequencies"] * bool(
        PREDICTED or UNPREDICTED
    )
    tables += ["claims"] * any(table in tables for table in CLAIMED)
    return [tabled(table) for table in tables]


def limits_of(table: str):
    """The limits beyond which a fit of a table is doubtful; None for a table that is not judged."""
    return CONFIG.doubtful.of(table).model_dump(mode="json") if table in judged_tables() else None


def rows_behind(table: str) -> list[Path]:
    """The results of single trials behind a table, also behind a derived one."""
    if table in EXPERIMENTS["walking"].further_tables:
        return [*crossings(WALKED), *rows("walking")]
    source = DERIVED.get(table, (table,))[0]
    return rows(source) if source in PER_TRIAL else []


DRIVETRAIN = {"weight": setting("gain_weight"), "sign_width": CONFIG.model_comparison.sign_width}
DRIVETRAIN["settings"] = CONFIG.dynamometer.part("FilterSettings")


MEASURED = {part: tabled(part) for part in PARTS} if PREDICTED else {}
PREDICTIONS = {"input": {"table": tabled("impedance"), "law": tabled("law")}, **PARAMETERS}
PREDICTIONS |= {
    "after": [*MEASURED.values()],
    "read": {"components": MEASURED, "records": rows("record", PREDICTED)},
}
PREDICTIONS |= {"settings": DRIVETRAIN | {"unpredicted": UNPREDICTED}}
GATHERED = {"output": tabled("prediction"), "causes": tabled("prediction_causes")}
GATHERED |= {"frequencies": tabled("prediction_frequencies")}
single("bench.gather_predictions", GATHERED, "tables/prediction", PREDICTIONS)


@step("tables.check_claims", tabled("claims"))
def check_claims(_):
    tables = [path for path in result_tables() if path.stem in CLAIMED]
    settings = {
        "settings": setting("claims"),
        "frequencies_hz": CONFIG.dynamometer.frequencies_hz or (),
    }
    settings |= {"midstance": CONFIG.figures.midstance_stiffness}
    return {
        "after": tables,
        "read": {"tables": by_stem(tables)},
        "settings": settings,
        **PARAMETERS,
    }


def gathered(of: str):
    """The parts of the job that joins the tables of single trials."""
    judged = next(
        (one.doubts_of for name, one in TABLES if one.name == of and CAMPAIGN.trials(name)), ""
    )
    settings = {"limits": limits_of(of), "limits_of_fits": limits_of(judged)}
    settings["places"] = {trial: place for trial, place in PLACES.items() if trial in PER_TRIAL[of]}
    read = {"rows": rows(of), "quality": verdicts_on(of)} | (
        {"fits": rows(judged)} if judged else {}
    )
    return {"after": behind(of), "read": read, "settings": settings}


@step(
    "tables.gather", tabled("{table}"), table="|".join(PER_TRIAL.keys() - {"quality", "impedance"})
)
def table(wildcards):
    return gathered(wildcards.table)


@step(
    "tables.gather",
    {"output": tabled("impedance"), "evidence": tabled("impedance_evidence")},
    "tables/impedance",
)
def impedance_tables(_):
    parts, columns = gathered("impedance"), described_tables_by_name()["impedance_evidence"].columns
    return {**parts, "settings": parts["settings"] | {"evidence_columns": [*columns]}}


step("", tabled("{derived}"), name="derived_table", derived="|".join(DERIVED))(
    lambda one: {
        "command": DERIVED[one.derived][1],
        "input": {"table": tabled(DERIVED[one.derived][0])},
    }
)


OF_GAINS = {
    "files": {
        "trajectory": CONFIG.impedance_trajectory or [],
        "parameters": CONFIG.parameters or [],
    }
}
OF_GAINS["settings"] = {"weight": setting("gain_weight")}
single("gains.select_trajectory", tabled("gains"), "tables/gains", OF_GAINS, "gains_table")


@step("tables.write_settings", tabled("settings"))
def settings_table(_):
    phasors = {"phasors": tabled("phasors")} if tabled("phasors") in result_tables() else {}
    experiments = [name for name in EXPERIMENTS if CAMPAIGN.trials(name)]
    return {"input": phasors, "settings": {"states": states_of(CONFIG, config, experiments)}}


@step("tables.list_excluded", tabled("excluded"))
def excluded_trials(_):
    """It waits for the results of single trials of every kind, and names those that have none."""
    waits = [*fitted(*EXPERIMENTS), *[SELECTION] * bool(WALKED)]
    calibrations = map(calibration, CAMPAIGN.statics if WALKED else ())
    read = {
        "fitted": [
            *crossings(WALKED),
            *calibrations,
            *(path for table in PER_TRIAL for path in rows(table)),
        ]
    }
    settings = {"by_sheet": dict(CAMPAIGN.excluded), "places": PLACES}
    return {
        "input": {"verdicts": tabled("quality")},
        "after": waits,
        "read": read,
        "settings": settings,
    }


@step("tables.write_findings", tabled("findings"))
def findings(_):
    tables = [path for path in result_tables() if path.stem in (*judged_tables(), *JUDGED_FURTHER)]
    inputs = {
        "input": {"verdicts": tabled("quality")},
        "after": tables,
        "read": {"tables": by_stem(tables)},
    }
    return {**inputs, "settings": {"limits": setting("doubtful"), "places": PLACES}}


@step("tables.write_summary", {"summary_json": "summary.json", "numbers_tex": "numbers.tex"})
def headline_numbers(_):
    """Headline numbers, also of the desired impedance of Fig. 4."""
    row = CAMPAIGN.row(TIME_SERIES["trial"]) if TIME_SERIES else {}
    example = (
        {"K_d": row["K_d"], "B_d": row["B_d"], "chosen": TIME_SERIES["chosen"]} if row else None
    )
    trials = {name: CAMPAIGN.trials(name) for name in EXPERIMENTS if CAMPAIGN.trials(name)}
    settings = {
        "about": ABOUT,
        "example": example,
        "trials": trials,
        "beside_draft": CAMPAIGN.beside_draft,
    }
    inputs = {
        "input": {name: tabled(name) for name in ("excluded", "findings")}
        | {"verdicts": tabled("quality")}
    }
    tables = {"after": result_tables(), "read": {"table_paths": by_stem(result_tables())}}
    return {**inputs, **tables, "settings": settings}
