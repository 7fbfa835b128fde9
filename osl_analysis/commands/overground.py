"""The job that compares the ankle moment of overground gait with the one that its laboratory computed."""

from collections.abc import Mapping
from pathlib import Path

import polars as pl

from osl_analysis.table import write_table
from osl_analysis.trial import read_trial
from osl_analysis.walking.overground import overground_rows
from osl_analysis.walking.settings import OvergroundAnalysis


def compare_ankle_moment(trial: Path, settings: OvergroundAnalysis, tables: Mapping[str, Path]) -> None:
    """One row per stance and plate of a trial: our ankle moment and the laboratory's."""
    write_table(pl.DataFrame(overground_rows(read_trial(trial), settings)), tables["ankle_moment"])
