"""Jobs from analysed crossings to tables: selection, unperturbed gait, fits, and the numbers of Fig. 9."""

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from osl_analysis.commands.walking_files import (
    on_the_walkway,
    read_crossing,
    read_crossing_file,
    read_unperturbed_gaits,
    write_unperturbed_gaits,
)
from osl_analysis.errors import InputError, OslAnalysisError
from osl_analysis.judge.doubts import DOUBTFUL, EXCLUDED, doubtful_row, marked
from osl_analysis.judge.table import Doubt
from osl_analysis.shared_choices import SYNTHETIC, read_impedance_trajectory
from osl_analysis.table import MEASURED, Places, read_table, write_table
from osl_analysis.trial import Array, Trial
from osl_analysis.walking.crossing import Crossing, RefusedCrossing
from osl_analysis.walking.ensemble import group_headline
from osl_analysis.walking.gait import UnperturbedGait, unperturbed_gait
from osl_analysis.walking.groups import ALL, SEPARATOR, selection_rows, statements
from osl_analysis.walking.overground import overground_rows
from osl_analysis.walking.settings import (
    EnsembleSettings,
    OvergroundAnalysis,
    ResponseSettings,
    SelectionSettings,
    UnperturbedSettings,
)
from osl_analysis.walking.tables import (
    ENSEMBLE,
    FACTS,
    QUANTITIES,
    Group,
    excluded_crossings,
    fitted_time,
    group_facts,
    group_row,
    groups_of,
    headline_rows,
    impedance_over_stance,
    perturbation_row,
    response_table,
    with_trajectory,
)

FEWEST_PERTURBED = 2  # Fewest perturbations of a result
NO_GAIT = (
    "no mean unperturbed gait under the same conditions: fewer unperturbed crossings than fewest_unperturbed are used; "
    "record more, or leave the condition empty in the sheet where unperturbed crossings serve every value"
)


GroupResult = tuple[Sequence[Mapping[str, Any]], Mapping[str, Any], pl.DataFrame | None]
"""Of a group: rows of `walking_summary.csv`, its row of `walking_groups.csv`, responses; None without a result."""


def group_result(
    group: Group,
    own: pl.DataFrame,
    files: Mapping[str, Path],
    gait: UnperturbedGait | None,
    settings: EnsembleSettings,
) -> GroupResult:
    """The result of a group; without one, rows with the reason, and a warning. `own` are its rows of `walking.csv`."""
    known = {"group": group.name}
    fact: dict[str, Any] = group_row(group, gait, settings.window_s) | {"fitted_phase": None, "reason": None}
    try:
        if gait is None:
            raise InputError(NO_GAIT)
        if len(own) < FEWEST_PERTURBED:
            raise InputError(
                f"{len(own)} perturbations can be used, expected {FEWEST_PERTURBED} or more for a scatter; see the "
                "reasons in walking_excluded.csv, or record more"
            )
        headline = group_headline([read_crossing(files[trial]) for trial in own["trial"]], gait, settings)
    except OslAnalysisError as error:
        warnings.warn(f"no result of {group.name}: {error}", stacklevel=2)
        none = {"estimator": ENSEMBLE, "n": len(own), "mean": None, "reason": str(error)}
        rows = [known | {"quantity": quantity} | none for quantity in QUANTITIES]
        return rows, fact | {"reason": str(error)}, None
    time = fitted_time(headline.ensemble, settings.timing)
    fact["fitted_phase"] = float(fact["onset_phase"] + time / fact["stance_s"])
    rows = [
        known | row | {"commanded": group.cells.get(f"{row['quantity']}_d"), "reason": None}
        for row in headline_rows(headline, own, doubtful_row(own))
    ]
    curve = response_table(group.name, headline.responses, headline.ensemble)
    return rows, fact | group_facts(headline), curve


HEADLINES = ("group", "quantity", "estimator", "n", "mean", "se", "low", "high", "commanded")
STANCE = np.linspace(0, 1, 101)  # Phases of stance at which the commanded trajectory is drawn


def select_crossings(
    crossings: Sequence[Path],
    settings: SelectionSettings,
    output: Path,
    sheet: Mapping[str, Mapping[str, Any]] | None = None,
    places: Places | None = None,
) -> None:
    """One row per crossing, in the order of the files: its quality, its group and, if it is excluded, the reason.
    `sheet` has the conditions of every crossing of the campaign, `places` joint and side of each. A warning says by
    which conditions results are split although the configuration does not ask for it."""
    read = [read_crossing_file(path) for path in crossings]
    analysed = [c for c in read if isinstance(c, Crossing)]
    refused = [c for c in read if isinstance(c, RefusedCrossing)]
    rows = selection_rows(analysed, refused, settings, sheet)
    table = pl.DataFrame([rows[path.stem] for path in crossings], infer_schema_length=None)
    said = statements(sheet or {}, settings)
    timed = [name for name in table["group"].drop_nulls().unique(maintain_order=True) if "timing " in name]
    if timed and "timing" not in settings.group_by:
        said.append(
            f"perturbations begin at {len(timed)} different phases of stance ({'; '.join(sorted(timed))}): each has a "
            "result of its own; write timing under walking.group_by to keep that, or under walking.pool for one result"
        )
    for sentence in said:
        warnings.warn(sentence, stacklevel=2)
    write_table(on_the_walkway(table, places), output)


def average_unperturbed(
    crossings: Sequence[Path], selection: Path, settings: UnperturbedSettings, output: Path
) -> None:
    """The unperturbed crossings that the table `selection` does not exclude, on a common grid of stance phase, by gait,
    to a Parquet file. A gait with too few of them is left out with a warning."""
    unperturbed = [crossing for crossing in selected_crossings(crossings, selection) if crossing.onset is None]
    names_of = {path.stem for path in crossings}
    table = read_table(selection, ["trial", "gait", "reason"]).filter(pl.col("trial").is_in(names_of))
    served = {row["trial"]: (row["gait"] or "").split(SEPARATOR) for row in table.iter_rows(named=True)}
    reasons = {row["trial"]: row["reason"] for row in table.iter_rows(named=True) if row["reason"]}
    names = dict.fromkeys(name for gaits in served.values() for name in gaits if name) or {ALL: None}
    gaits, problems = {}, []
    for name in names:
        try:
            own = [crossing for crossing in unperturbed if name in served[crossing.name]]
            lost = {trial: why for trial, why in reasons.items() if name in (*served[trial], ALL)}
            gaits[name] = unperturbed_gait(own, settings.fewest_unperturbed, lost)
        except InputError as error:
            problems.append(f"{error}" if name == ALL else f"{name}: {error}")
    if not gaits:
        raise InputError("; ".join(problems))
    for problem in problems:
        warnings.warn(problem, stacklevel=2)
    write_unperturbed_gaits(gaits, output)


def fit_perturbation(
    crossing: Path, selection: Path, unperturbed: Path, settings: ResponseSettings, output: Path
) -> None:
    """Fit Eq. 15 to the isolated response of one perturbed crossing: one row of `walking.csv`. A crossing that is
    excluded, or whose response cannot be fitted, has a row with the reason and no numbers."""
    gaits, columns = read_unperturbed_gaits(unperturbed), ("reason", "gait", "group", "direction")
    rows = read_table(selection, ["trial", *columns]).filter(pl.col("trial") == crossing.stem)
    place = dict.fromkeys(columns) if rows.is_empty() else rows.select(columns).row(0, named=True)
    reason, gait = place["reason"], gaits.get(place["gait"] or ALL)
    row: dict[str, object] = {}
    if reason is None and gait is None:
        reason = NO_GAIT
    if reason is None and gait is not None:
        try:
            row = perturbation_row(read_crossing(crossing), gait, settings)
        except OslAnalysisError as error:
            reason = str(error)
    known = {"trial": crossing.stem, "group": place["group"], "direction": place["direction"]}
    row = row or dict.fromkeys(QUANTITIES)  # a campaign in which no perturbation can be used keeps its other results
    write_table(pl.DataFrame([known | row | {EXCLUDED: reason}]), output)


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
    groups: Path,
    sheet: Mapping[str, Mapping[str, Any]] | None = None,
    limits: Doubt | None = None,
    places: Places | None = None,
) -> None:
    """Per group the mean over perturbations and the ensemble fit to `output`, its conditions to `groups`, every
    response in its window to `responses`, and the crossings that are not used, with the reason, to `excluded`. `table`
    is `walking.csv`, `crossings` are the perturbed ones. A group without a result has rows with the reason. A group
    beyond one of the `limits` is doubtful, and so is its ensemble. `places` has joint and side of each crossing."""
    fits, chosen = read_table(table, ["trial"]), read_table(selection, ["trial", "reason", "gait", "group"])
    reasons = fits.select("trial", pl.col(EXCLUDED).alias("reason"))
    write_table(on_the_walkway(excluded_crossings(chosen, reasons), places), excluded)
    fitted = fits.filter(pl.col(EXCLUDED).is_null())
    if len(fitted) < FEWEST_PERTURBED:
        raise InputError(
            f"{table}: {len(fitted)} of {len(fits)} perturbations can be used, expected {FEWEST_PERTURBED} or more for "
            f"a scatter; see the reasons in {excluded.name}, or record more"
        )
    gaits, files = read_unperturbed_gaits(unperturbed), {path.stem: path for path in crossings}
    sides, results = {}, []
    for group in groups_of(chosen, sheet):
        of = {(places or {}).get(trial, {}).get("side") for trial in group.trials}
        sides[group.name] = {"side": of.pop() if len(of) == 1 else None}
        own = fitted.filter(pl.col("trial").is_in(group.trials))
        results.append(group_result(group, own, files, gaits.get(group.gait), settings))
    facts, curves = [fact for _, fact, _ in results], [curve for _, _, curve in results if curve is not None]
    if not curves:
        why = {fact["group"]: fact["reason"] for fact in facts}
        said = "; ".join(reason if name == ALL else f"{name}: {reason}" for name, reason in why.items())
        raise InputError(f"{table}: no result from {len(fits)} perturbations: {said}; see {excluded.name}")
    judged = marked(pl.DataFrame(facts, infer_schema_length=None), limits or Doubt(), "walking_groups")
    doubts = dict(zip(judged["group"], judged[DOUBTFUL], strict=True))
    rows = [
        {**row, "doubt": doubts[str(row["group"])] if row["estimator"] == ENSEMBLE else None}
        for of_group, _, _ in results
        for row in of_group
    ]
    write_table(on_the_walkway(pl.DataFrame(rows, infer_schema_length=None), sides, "group"), output)
    write_table(on_the_walkway(judged.drop("side"), sides, "group"), groups)
    write_table(on_the_walkway(pl.concat(curves), sides, "group"), responses)


def selected_crossings(crossings: Sequence[Path], selection: Path) -> list[Crossing]:
    """The crossings that the table `selection` does not exclude."""
    excluded = read_table(selection, ["trial", "reason"]).drop_nulls("reason")["trial"].to_list()
    return [read_crossing(path) for path in crossings if path.stem not in excluded]


def compare_ankle_moment(
    trial: Trial, settings: OvergroundAnalysis, condition: Mapping[str, float | None] | None = None
) -> Mapping[str, pl.DataFrame]:
    """One row per stance and plate of a trial: our ankle moment and the laboratory's. `condition` has the sheet's body
    mass [kg] under `body_mass_kg`, if it states one."""
    mass = (condition or {}).get("body_mass_kg")
    return {"ankle_moment": pl.DataFrame(overground_rows(trial, settings, mass))}


def tabulate_over_stance(
    summary: Path, groups: Path, output: Path, stance_share: float, trajectory: Sequence[Path] = (), data: str = ""
) -> None:
    """K, B and I of every group at the phase of stance that its fit reads, with interval and commanded value.
    `trajectory` has the file of the commanded impedance over the gait cycle, if there is one; stance is the first
    `stance_share` of it."""
    table = impedance_over_stance(read_table(summary, HEADLINES), read_table(groups, FACTS))
    for path in commanded(trajectory, data):
        table = with_trajectory(table, *over_stance(path, stance_share))
    write_table(table, output)


def commanded(trajectory: Sequence[Path], data: str) -> list[Path]:
    """The files of trajectories that the leg was commanded; `data` are `simulated` or `measured`. A synthetic
    trajectory is made for the simulated leg: no measured one was commanded it."""
    return [p for p in trajectory if data != MEASURED or read_impedance_trajectory(p).kind != SYNTHETIC]


def over_stance(trajectory: Path, stance_share: float) -> tuple[Array, Array, Array]:
    """Phases of stance (n,) and the commanded K_d [N*m/rad] and B_d [N*m*s/rad] there."""
    desired = read_impedance_trajectory(trajectory)
    cycle = STANCE * stance_share
    return STANCE, desired.at(desired.K_d, cycle), desired.at(desired.B_d, cycle)
