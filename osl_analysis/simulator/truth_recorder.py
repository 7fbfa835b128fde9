"""The truth about simulated trials, written to the folder `truth`, which ingest never reads."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import polars as pl

from osl_analysis.files import atomic_path
from osl_analysis.model.compensator import Gains
from osl_analysis.parameters import DrivetrainParameters
from osl_analysis.simulator.settings import SimulationSettings
from osl_analysis.trial import Array


def bench_truth(
    trial: str,
    settings: SimulationSettings,
    p: DrivetrainParameters,
    gains: Gains | None,
    drawn: Mapping[str, float],
) -> dict[str, object]:
    """The truth of a bench trial: parameters (with this trial's K_s), gains, effects, recorder and `drawn` errors."""
    return {
        "trial": trial,
        "seed": settings.seed,
        "parameters": asdict(p),
        "gains": asdict(gains) if gains else None,
        "joint": settings.joint.model_dump() if settings.joint else None,
        **({"foot": settings.foot.model_dump()} if settings.foot else {}),
        "effects": settings.effects.model_dump(),
        "recorder": settings.recorder.model_dump(),
        "drawn": dict(drawn),
    }


def write_truth(folder: Path, trial: str, truth: Mapping[str, object]) -> None:
    """Write the truth of a trial to `truth/<trial>.json` in the campaign's raw folder."""
    with atomic_path(folder / "truth" / f"{trial}.json") as path:
        path.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")


def write_curves(folder: Path, trial: str, curves: dict[str, Array], every: int) -> None:
    """Write every `every`-th sample of the exact curves to `truth/<trial>.parquet` in the campaign's raw folder."""
    with atomic_path(folder / "truth" / f"{trial}.parquet") as path:
        pl.DataFrame({name: values[::every] for name, values in curves.items()}).write_parquet(path)
