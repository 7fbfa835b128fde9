"""The crossings of a session side by side: their quality, and which of them are left out and why."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl

from osl_analysis.commands.crossing_file import Refusal, read_crossing, read_outcomes
from osl_analysis.table import read_table, write_table
from osl_analysis.walking.crossing import Crossing
from osl_analysis.walking.perturbation import Timing
from osl_analysis.walking.selection import Feature, features, outliers
from osl_analysis.walking.settings import WalkingAnalysis

USED, OUTLIER, REFUSED = "used", "outlier", "refused"


def select(crossings: Sequence[Path], settings: WalkingAnalysis, output: Path) -> None:
    """One row per crossing: quality and, if it is left out, why; in the order of the files."""
    walked, refused = read_outcomes(crossings)
    rule = settings.outliers
    found = (
        features(walked, Timing(settings.window_s, settings.baseline_s, settings.guard_s), rule)
        if rule and walked
        else []
    )
    reasons = outliers(found, [c.name for c in walked], rule.limit) if rule and walked else {}
    rows = {c.name: crossing_row(c, k, found, reasons.get(c.name)) for k, c in enumerate(walked)}
    rows |= {r.name: refused_row(r) for r in refused}
    table = pl.DataFrame([rows[path.stem] for path in crossings], infer_schema_length=None)
    write_table(table, output)


def crossing_row(crossing: Crossing, index: int, found: Sequence[Feature], reason: str | None) -> dict[str, object]:
    """One row of `walking_crossings.csv`: angles in deg, residuals in mm, the encoder's delay in ms."""
    quality, encoder = crossing.quality, crossing.quality.encoder
    furthest = max((float(f.distance[index]) for f in found), default=None)
    return {
        "trial": crossing.name,
        "perturbed": crossing.onset is not None,
        "status": USED if reason is None else OUTLIER,
        "reason": reason,
        "stance_s": crossing.stance.duration,
        "onset_s": crossing.onset,
        "foot_forward_m": quality.placement[0],
        "foot_left_m": quality.placement[1],
        "gait_deviation_deg": next((float(f.values[index]) for f in found if f.unit == "deg"), None),
        "furthest_scatters": furthest,
        "bridged": crossing.bridged,
        **{f"{name}_residual_mm": 1e3 * size for name, size in quality.residuals.items()},
        "plate_zero_N": quality.zero,
        "encoder_offset_deg": encoder and float(np.rad2deg(encoder.offset)),
        "encoder_delay_ms": encoder and 1e3 * encoder.delay,
        "encoder_rms_deg": encoder and float(np.rad2deg(encoder.rms)),
    }


def refused_row(refusal: Refusal) -> dict[str, object]:
    """The row of a crossing that could not be analysed."""
    return {"trial": refusal.name, "perturbed": refusal.perturbed, "status": REFUSED, "reason": refusal.reason}


def used(crossings: Sequence[Path], selection: Path) -> list[Crossing]:
    """The crossings that the selection does not leave out, read."""
    return [read_crossing(path) for path in crossings if left_out(path, selection) is None]


def left_out(crossing: Path, selection: Path) -> str | None:
    """Why a crossing is left out; None if it is not."""
    rows = read_table(selection, ["trial", "reason"]).filter(pl.col("trial") == crossing.stem)
    return None if rows.is_empty() else rows["reason"][0]
