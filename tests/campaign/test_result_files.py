# SPDX-License-Identifier: Apache-2.0
"""The files of a campaign's results."""

from shipped import CONFIG

from osl_analysis.campaign.campaign_trials import open_campaign
from osl_analysis.campaign.result_files import ResultFiles, name_pattern
from osl_analysis.config.sheet import read_sheet

SHEET = """trial,experiment,log,log_source,joint
b1,belt,b1.mcap,dynamometer,ankle
a1,actuator,a1.mcap,dynamometer,ankle
i1,impedance,i1.mcap,dynamometer,ankle
"""


def test_a_fit_has_a_file_of_rows_and_an_archive_of_its_other_tables(tmp_path):
    (tmp_path / "trials.csv").write_text(SHEET)
    files = ResultFiles(open_campaign(CONFIG, read_sheet(tmp_path / "trials.csv")))

    fits = f"{CONFIG.results}/fits"
    assert files.rows("belt") == [f"{fits}/belt/b1.csv"]
    assert files.rows("belt_curves") == [f"{fits}/belt/b1.zip"]
    assert files.rows("timebase") == [
        f"{fits}/{trial}.zip" for trial in ("belt/b1", "actuator/a1", "impedance/i1")
    ]


def test_a_wildcard_of_no_name_matches_nothing():
    assert name_pattern(["a.b", "c"]) == r"a\.b|c"
    assert name_pattern([]) == "(?!)"
