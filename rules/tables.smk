"""Fits of single trials -> tidy tables."""

FILLED_BY = {  # table: the trials whose fits are its rows
    "belt": CAMPAIGN.trials("belt"),
    "belt_curves": CAMPAIGN.trials("belt"),
    "transmission": CAMPAIGN.trials("transmission"),
    "actuator": CAMPAIGN.trials("actuator"),
    "impedance": CAMPAIGN.trials("impedance"),
    "phasors": CAMPAIGN.trials("impedance"),
    "model_comparison": comparisons(),
    "estimators": CAMPAIGN.trials("impedance"),
    "walking": CAMPAIGN.crossings(perturbed=True),
    "ankle_moment": CAMPAIGN.trials("overground"),
    "quality": CAMPAIGN.trials(),
}
SUMMARISED = ("belt", "transmission", "actuator", "model_comparison")


def fitted(*tables: str) -> list[Path]:
    """The fits of single trials behind these tables, or behind all."""
    return [path for table in tables or FILLED_BY for path in rows_of(table)]


def rows_of(table: str) -> list[Path]:
    """The files of single trials that a table brings together."""
    if table == "quality":
        return checked(FILLED_BY[table])
    return [RESULTS / f"fits/{table}/{trial}.csv" for trial in FILLED_BY[table]]


def verdicts_on(table: str) -> list[Path]:
    """What quality control says of a table's trials; its own table leaves none of them out."""
    return [] if table == "quality" else checked(name for name in FILLED_BY[table] if name in CAMPAIGN.sheet.index)


def result_tables() -> list[Path]:
    """Every table that the campaign's experiments give."""
    tables = [table for table, trials in FILLED_BY.items() if trials and table not in ("belt_curves", "quality")]
    tables += [f"{table}_summary" for table in (*SUMMARISED, "walking") if table in tables]
    tables += ["walking_crossings", "walking_excluded", "hinge", "plate"] * ("walking" in tables)
    tables += ["frequency_response"] * ("impedance" in tables)
    tables += ["gains"] * bool(CONFIG.impedance_trajectory)
    return [RESULTS / f"tables/{table}.csv" for table in tables]


def doubt_limits(params) -> Doubt | None:
    """What makes a fit of the table doubtful, as the job's parameters carry it; None for a table that is not judged."""
    return params.limits and Doubt.model_validate(params.limits)


rule table:
    input:
        rows=lambda wildcards: fitted(wildcards.table),
        quality=lambda wildcards: verdicts_on(wildcards.table),
    output:
        RESULTS / "tables/{table}.csv",
    log:
        RESULTS / "logs/tables/{table}.log",
    wildcard_constraints:
        table="|".join(FILLED_BY),
    params:
        code=jobs.code("commands.tables"),
        limits=lambda wildcards: CONFIG.doubtful.model_dump(mode="json").get(wildcards.table),
    run:
        jobs.run_job(
            log[0],
            "tables.gather",
            rows=kept(input.rows, input.quality),
            output=Path(output[0]),
            limits=doubt_limits(params),
        )


rule summary_table:
    input:
        table=RESULTS / "tables/{table}.csv",
    output:
        RESULTS / "tables/{table}_summary.csv",
    log:
        RESULTS / "logs/tables/{table}_summary.log",
    wildcard_constraints:
        table="|".join(SUMMARISED),
    params:
        code=lambda wildcards: jobs.code_of(f"bench.summarise_{wildcards.table}"),
    run:
        jobs.run_job(
            log[0],
            f"bench.summarise_{wildcards.table}",
            table=Path(input.table),
            output=Path(output[0]),
        )


rule gains_table:
    input:
        trajectory=CONFIG.impedance_trajectory or [],
        parameters=CONFIG.parameters,
    output:
        RESULTS / "tables/gains.csv",
    log:
        RESULTS / "logs/tables/gains.log",
    params:
        code=jobs.code("commands.gains"),
        weight=WEIGHT,
    run:
        jobs.run_job(
            log[0],
            "gains.select_trajectory",
            trajectory=Path(input.trajectory),
            parameters=Path(input.parameters),
            weight=gain_weight(params),
            output=Path(output[0]),
        )
