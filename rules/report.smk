"""Everything that a run made -> the page on which a reader finds a trial behind a number (report.html)."""


def report_tables() -> list[Path]:
    """The tables on the page."""
    return [*result_tables(), *([tabled("walking_responses")] if CAMPAIGN.trials("walking") else [])]


def drawn_svg() -> list[Path]:
    """The figures on the page."""
    return [RESULTS / f"figures/{name}.svg" for name in drawn_names()]


@step("report.write_report", RESULTS / "report.html", "report", name="report")
def report_page(_):
    return {
        "made_of": sorted(TEMPLATES.iterdir()),
        "input": {
            **({"captions": RESULTS / "figures/captions.md"} if drawn_names() else {}),
            "tables": report_tables(),
            "figures": drawn_svg(),
            "verdicts": tabled("quality"),
            "excluded": tabled("excluded"),
            "summary": RESULTS / "summary.json",
        },
        "read": {
            "trials": by_stem(ingested()),
            "series": by_stem(rows("series") if "series" in PER_TRIAL else []),
            "crossings": by_stem(crossings(CAMPAIGN.trials("walking"))),
            "tables": by_stem(report_tables()),
            "figures": by_stem(drawn_svg()),
        },
        "settings": {
            "about": asdict(ABOUT),
            "sheet": CAMPAIGN.rows | CAMPAIGN.unused,
            "largest_mb": CONFIG.report.largest_mb,
        },
    }
