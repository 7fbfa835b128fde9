"""Jobs from analysed crossings to tables: selection, unperturbed gait, fits, and the numbers of Fig. 9."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import polars as pl

from osl_analysis.commands.walking_files import (
    read_crossing,
    read_crossing_files,
    read_unperturbed_gait,
    write_unperturbed_gait,
)
from osl_analysis.doubtful import DOUBTFUL, EXCLUDED, doubtful_row
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.table import read_table, write_table
from osl_analysis.trial import read_trial
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.ensemble import bootstrap, common_errors, ensemble_response
from osl_analysis.walking.overground import overground_rows
from osl_analysis.walking.response import isolate_response
from osl_analysis.walking.selection import selection_rows
from osl_analysis.walking.settings import (
    EnsembleSettings,
    OvergroundAnalysis,
    ResponseSettings,
    SelectionSettings,
    TimingSettings,
    UnperturbedSettings,
)
from osl_analysis.walking.tables import (
    ensemble_rows,
    excluded_crossings,
    mean_rows,
    perturbation_row,
    response_table,
    walking_page_points,
)
from osl_analysis.walking.unperturbed import unperturbed_gait


def select_crossings(crossings: Sequence[Path], settings: SelectionSettings, output: Path) -> None:
    """One row per crossing, in the order of the files: its quality and, if it is excluded, the reason."""
    rows = selection_rows(*read_crossing_files(crossings), settings)
    write_table(pl.DataFrame([rows[path.stem] for path in crossings], infer_schema_length=None), output)


def average_unperturbed(
    crossings: Sequence[Path], selection: Path, settings: UnperturbedSettings, output: Path
) -> None:
    """The unperturbed ones of the crossings on a common grid of stance phase, to a Parquet file.

    Crossings that the table `selection`, `walking_crossings.csv`, excludes are not used.
    """
    unperturbed = [crossing for crossing in selected_crossings(crossings, selection) if crossing.onset is None]
    write_unperturbed_gait(unperturbed_gait(unperturbed, settings.fewest_unperturbed), output)


def fit_perturbation(
    crossing: Path, selection: Path, unperturbed: Path, settings: ResponseSettings, output: Path
) -> None:
    """Fit Eq. 15 to the isolated response of one perturbed crossing: one row of `walking.csv`.

    A crossing that is excluded, or whose response cannot be fitted, has a row with the reason and no numbers.
    """
    gait, reason = read_unperturbed_gait(unperturbed), exclusion_reason(crossing, selection)
    row: dict[str, object] = {}
    if reason is None:
        try:
            row = perturbation_row(read_crossing(crossing), gait, settings)
        except OslAnalysisError as error:
            reason = str(error)
    write_table(pl.DataFrame([(row or {"trial": crossing.stem}) | {EXCLUDED: reason}]), output)


def summarise_perturbations(
    *,
    table: Path,
    crossings: Sequence[Path],
    selection: Path,
    unperturbed: Path,
    settings: EnsembleSettings,
    output: Path,
    responses: Path,
    excluded: Path,
) -> None:
    """Mean over perturbations and ensemble fit to `output`, every response in its window to `responses`, and the
    crossings that are not used, with the reason, to `excluded`.

    `table` is `walking.csv`, `crossings` are the perturbed ones, `selection` is `walking_crossings.csv`.
    """
    fits = read_table(table, ["trial"])
    reasons = fits.select("trial", pl.col(EXCLUDED).alias("reason"))
    write_table(excluded_crossings(read_table(selection, ["trial", "reason"]), reasons), excluded)
    fitted = fits.filter(pl.col(EXCLUDED).is_null())
    if len(fitted) < 2:
        raise InputError(
            f"{table}: {len(fitted)} of {len(fits)} perturbations can be used, expected 2 or more for a scatter; see "
            f"the reasons in {excluded.name}, or record more"
        )
    gait, names = read_unperturbed_gait(unperturbed), set(fitted["trial"])
    isolated = [
        isolate_response(read_crossing(path), gait, settings.timing, settings.perturbed_stance)
        for path in crossings
        if path.stem in names
    ]
    ensemble = ensemble_response(isolated)
    rows = [row | doubtful_row(fitted) for row in mean_rows(fitted, common_errors(isolated))]
    rows += ensemble_rows(ensemble, bootstrap(isolated, settings.bootstrap_samples))
    write_table(pl.DataFrame(rows), output)
    write_table(response_table(isolated, ensemble), responses)


def plot_walking_page(
    *,
    crossings: Sequence[Path],
    selection: Path,
    unperturbed: Path,
    responses: Path,
    table: Path,
    settings: TimingSettings,
    output: Path,
) -> None:
    """Write the numbers that the walking page plots.

    `crossings` are the perturbed ones, `selection` is `walking_crossings.csv`, `responses` `walking_responses.csv`,
    `table` `walking.csv`.
    """
    isolated = read_table(responses, ["trial", "time", "theta_deg", "torque", "torque_model"])
    doubtful = read_table(table, ["trial", DOUBTFUL]).select("trial", DOUBTFUL)
    isolated = isolated.join(doubtful, on="trial", how="left", maintain_order="left")
    names = set(isolated["trial"])
    perturbed = [c for c in selected_crossings(crossings, selection) if c.name in names]
    gaits = {"unperturbed": read_unperturbed_gait(unperturbed), "perturbed": unperturbed_gait(perturbed, 2)}
    write_table(walking_page_points(perturbed, gaits, isolated, settings.window_s), output)


def selected_crossings(crossings: Sequence[Path], selection: Path) -> list[Crossing]:
    """The crossings that the table `selection` does not exclude."""
    return [read_crossing(path) for path in crossings if exclusion_reason(path, selection) is None]


def exclusion_reason(crossing: Path, selection: Path) -> str | None:
    """Why the table `selection` excludes a crossing; None if it does not."""
    rows = read_table(selection, ["trial", "reason"]).filter(pl.col("trial") == crossing.stem)
    return None if rows.is_empty() else rows["reason"][0]


def compare_ankle_moment(
    trial: Path,
    settings: OvergroundAnalysis,
    tables: Mapping[str, Path],
    condition: Mapping[str, float | None] | None = None,
) -> None:
    """One row per stance and plate of a trial: our ankle moment and the laboratory's.

    `condition` has the body mass [kg] of the trial's row of the sheet under `body_mass_kg`, if it states one.
    """
    mass = (condition or {}).get("body_mass_kg")
    write_table(pl.DataFrame(overground_rows(read_trial(trial), settings, mass)), tables["ankle_moment"])
