"""Walking by formula: a foot, a shank and a moving plate whose every curve is written by hand."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import polars as pl
from scipy.special import erf

from osl_analysis.trial import Array, Trial, marker_columns, plate_columns
from osl_analysis.walking.bodies import Poses
from osl_analysis.walking.settings import WalkingAnalysis

RATE, PLATE_RATE = 300, 1500
FOOT = np.array([[-0.08, 0.01, 0.05], [0.16, 0.02, 0.03], [0.10, -0.05, 0.03], [0.06, 0.01, 0.12]])
SHANK = np.array([[0.05, -0.02, 0.18], [0.01, -0.07, 0.27], [-0.03, 0.05, 0.33], [0.06, 0.02, 0.41]])
PLATFORM = np.array([[0.28, 0.23, 0.0], [-0.28, 0.23, 0.0], [-0.28, -0.23, 0.06], [0.28, -0.23, 0.0]])
CORNERS = [[0.25, 0.25, 0.0], [0.25, -0.25, 0.0], [-0.25, -0.25, 0.0], [-0.25, 0.25, 0.0]]
CLUSTERS = {"FOOT": FOOT, "SHANK": SHANK, "PLAT": PLATFORM}

SETTINGS: dict[str, Any] = {
    "cutoff_hz": 20, "order": 4, "plate_cutoff_hz": 8, "side": "right", "plate": 1,
    "markers": {
        "foot": [f"FOOT{i}" for i in range(1, 5)], "shank": [f"SHANK{i}" for i in range(1, 5)],
        "platform": [f"PLAT{i}" for i in range(1, 5)], "ankle_medial": "ANKLE_MED", "ankle_lateral": "ANKLE_LAT",
    },
    "window_s": 0.1, "baseline_s": 0.06, "guard_s": 0.04, "load_on_n": 40, "load_off_n": 20,
    "unloaded_s": 0.2, "largest_zero_n": 100, "hinge": "anatomical",
    "outliers": {"limit": 5, "stance_s": 0.01, "placement_m": 0.005, "angle_deg": 0.5,
                 "torque_nm": 2, "load_share": 0.03, "pressure_m": 0.005},
    "load_of_weight": [0.7, 1.25], "largest_outside_m": 0.02,
    "shortest_stance_s": 0.3, "perturbation_deg": 1, "longest_gap_s": 0.05, "longest_fitted_gap_s": 0.01,
    "largest_residual_mm": 5,
    "fewest_unperturbed": 3, "perturbed_stance": "own", "correct_plate_lag": True, "bootstrap_samples": 200,
}  # fmt: skip


def settings(**changes: Any) -> WalkingAnalysis:
    return WalkingAnalysis.model_validate(SETTINGS | changes)


def about_y(angle: Array) -> Array:
    """Rotations (n, 3, 3) about the axis to the left: +x, the toes, goes down."""
    c, s, o, i = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    return np.moveaxis(np.array([[c, o, s], [o, i, o], [-s, o, c]]), 2, 0)


def pose(rotation: Array, position: Array, origin: Array | None = None) -> Poses:
    n = len(rotation)
    return Poses(rotation, position, np.zeros(3) if origin is None else origin, np.zeros(n), np.zeros(n, dtype=bool))


def moved(points: Array, rotation: Array, pivot: Array) -> Array:
    """Points (m, 3) turned about a pivot (3,): (n, m, 3)."""
    return np.einsum("nij,mj->nmi", rotation, points - pivot) + pivot


def recording(name: str, tracks: dict[str, Array], force: Array, moment: Array) -> Trial:
    """A trial: marker tracks (n, 3) at 300 Hz, wrench (5 n, 3) at 1500 Hz in the plate's axes about its centre."""
    n = len(force)
    frame = {"time": np.arange(n) / PLATE_RATE}
    frame |= dict(zip(plate_columns(1, "force"), force.T, strict=True))
    frame |= dict(zip(plate_columns(1, "moment"), moment.T, strict=True))
    fast = pl.DataFrame(frame).with_row_index("row")
    slow = {c: v for label, track in tracks.items() for c, v in zip(marker_columns(label), track.T, strict=True)}
    markers = pl.DataFrame(slow).with_columns(row=pl.arange(0, n, n // len(next(iter(slow.values()))), dtype=pl.UInt32))
    samples = fast.join(markers, on="row", how="left", maintain_order="left").drop("row")
    return Trial(name, samples, {"plates": [{"plate": 1, "type": 2, "corners": CORNERS}]})


def labelled(prefix: str, tracks: Array) -> dict[str, Array]:
    """Tracks (n, m, 3) by label."""
    return {f"{prefix}{k + 1}": tracks[:, k] for k in range(tracks.shape[1])}


def changed(trial: Trial, *columns: pl.Expr, **named: Any) -> Trial:
    """The trial with other columns."""
    return replace(trial, samples=trial.samples.with_columns(*columns, **named))


def hidden(trial: Trial, markers: Sequence[str], start: float, end: float) -> Trial:
    """The trial with markers hidden between two times [s]."""
    gone = pl.col("time").is_between(start, end)
    columns = [column for marker in markers for column in marker_columns(marker)]
    unseen = (pl.when(gone & pl.col(c).is_not_null()).then(float("nan")).otherwise(pl.col(c)) for c in columns)
    return changed(trial, *(seen.alias(column) for seen, column in zip(unseen, columns, strict=True)))


def static_trial(ankle: Array) -> Trial:
    """One second of standing; the malleoli 4 cm either side of the ankle (3,), the medial one to the left."""
    n = RATE
    tracks: dict[str, Array] = {}
    for prefix, points in CLUSTERS.items():
        tracks |= labelled(prefix, np.tile(points, (n, 1, 1)))
    side = np.array([0.0, 0.04, 0.0])
    tracks |= {"ANKLE_MED": np.tile(ankle + side, (n, 1)), "ANKLE_LAT": np.tile(ankle - side, (n, 1))}
    return recording("static", tracks, np.zeros((5 * n, 3)), np.zeros((5 * n, 3)))


def bump(time: Array, centre: float, width: float) -> tuple[Array, Array, Array]:
    """A smooth step from 0 to 1 (an error function) with its two derivatives."""
    u = (time - centre) / width
    first = np.exp(-(u**2)) / (width * np.sqrt(np.pi))
    return 0.5 * (1 + erf(u)), first, -2 * u / width * first
