"""Everything that a run made -> the page on which a reader finds a trial behind a number (report.html)."""


def by_stem(files) -> dict[str, str]:
    """These files by their names without suffix."""
    return {Path(file).stem: str(file) for file in files}


rule report:
    input:
        **({"captions": RESULTS / "figures/captions.md"} if drawn_names() else {}),
        tables=[*result_tables(), *([RESULTS / "tables/walking_responses.csv"] if CAMPAIGN.trials("walking") else [])],
        figures=lambda wildcards: [RESULTS / f"figures/{name}.svg" for name in drawn_names()],
        excluded=RESULTS / "tables/excluded.csv",
        summary=RESULTS / "summary.json",
    output:
        RESULTS / "report.html",
    log:
        RESULTS / "logs/report.log",
    group:
        "figures"
    params:
        code=[jobs.code_of("report.write_report"), *map(digest, sorted(TEMPLATES.iterdir()))],
        about=asdict(ABOUT),
        sheet=lambda wildcards: CAMPAIGN.every_row(),
        largest_mb=CONFIG.report.largest_mb,
    run:
        read = {
            "trials": by_stem(ingested()),
            "verdicts": by_stem(checked(CAMPAIGN.trials())),
            "series": by_stem(rows("series") if "series" in PER_TRIAL else []),
            "crossings": by_stem(crossings(CAMPAIGN.trials("walking"))),
            "tables": by_stem(input.tables),
            "figures": by_stem(input.figures),
        }
        jobs.run_job(log, "report.write_report", input, output, params, read=read)
