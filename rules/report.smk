"""Everything that a run made -> the page on which a reader finds a trial behind a number (report.html)."""


def by_stem(files) -> dict[str, str]:
    """These files by their names without suffix."""
    return {Path(file).stem: str(file) for file in files}


rule report:
    input:
        trials=ingested(),
        verdicts=checked(CAMPAIGN.trials()),
        series=rows("series") if "series" in PER_TRIAL else [],
        crossings=crossings(CAMPAIGN.trials("walking")),
        tables=[*result_tables(), *([RESULTS / "tables/walking_responses.csv"] if CAMPAIGN.trials("walking") else [])],
        figures=lambda wildcards: [RESULTS / f"figures/{name}.svg" for name in drawn_names()],
        captions=lambda wildcards: [file for file in drawn_files() if file.suffix == ".md"],
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
        several = {
            name: by_stem(input[name])
            for name in ("trials", "verdicts", "series", "crossings", "tables", "figures")
        }
        single = {"excluded": input.excluded, "summary": input.summary}
        single |= {"captions": file for file in input.captions}
        jobs.run_job(log, "report.write_report", {**several, **single}, output, params)
