"""Which results a campaign has, and from which files each is made."""

from pathlib import Path

from conftest import ROOT

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.configuration import read_config
from osl_analysis.campaign.result_files import ResultFiles, name_pattern
from osl_analysis.config.sheet import read_sheet

CONFIG = read_config(ROOT / "config/config.yaml")
ON_ANKLE = "b1,belt,b1.mcap,dynamometer,ankle,,,\na1,actuator,a1.mcap,actuator,ankle,,,\n"


def result_files(folder: Path, rows: str) -> ResultFiles:
    """The results of a campaign with these rows of the sheet."""
    sheet = folder / "trials.csv"
    sheet.write_text("trial,experiment,log,log_source,joint,controller,K_d,B_d\n" + rows)
    return ResultFiles(open_campaign(CONFIG, read_sheet(sheet)))


def test_a_fit_has_a_file_of_rows_and_an_archive_of_its_other_tables(tmp_path: Path) -> None:
    files = result_files(
        tmp_path, ON_ANKLE + "i1,impedance,i1.mcap,dynamometer,ankle,compensated,300,5\n"
    )

    fits = f"{CONFIG.results}/fits"
    assert files.rows("belt") == [f"{fits}/belt/b1.csv"]
    assert files.rows("belt_curves") == [f"{fits}/belt/b1.zip"]
    assert files.rows("timebase") == [
        f"{fits}/{trial}.zip" for trial in ("belt/b1", "actuator/a1", "impedance/i1")
    ]


def test_a_wildcard_of_no_name_matches_nothing() -> None:
    assert name_pattern(["a.b", "c"]) == r"a\.b|c"
    assert name_pattern([]) == "(?!)"
