"""The truth beside the logs, in a folder that ingest never reads."""

import json
from collections.abc import Mapping
from pathlib import Path

from osl_analysis.files import atomic_path


def write_truth(folder: Path, trial: str, truth: Mapping[str, object]) -> None:
    """Write what made a trial to `truth/<trial>.json` in the campaign's raw folder."""
    with atomic_path(folder / "truth" / f"{trial}.json") as path:
        path.write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
