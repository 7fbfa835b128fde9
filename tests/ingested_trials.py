# SPDX-License-Identifier: Apache-2.0
"""Ingested trials of the default campaign, bit by bit.

`make test-ingest` compares results/trials with ingested_trials.csv after `make reproduce-all`;
`python tests/ingested_trials.py --keep` writes that file anew, and the commit shows what changed.
Another processor may simulate other bits: where a recording's digest differs, its trial is counted
and not compared.
"""

import hashlib
import sys
from pathlib import Path

import polars as pl

from osl_analysis.base.trial import read_trial

KEPT = Path(__file__).with_suffix(".csv")


def digest_of(samples: pl.DataFrame) -> str:
    """Digest of the names and of every bit of the samples; a sample that is missing is NaN."""
    digest = hashlib.sha256()
    for signal in samples:
        digest.update(signal.name.encode())
        digest.update(signal.cast(pl.Float64).fill_null(float("nan")).to_numpy().tobytes())
    return digest.hexdigest()[:16]


def row_of(path: Path) -> dict[str, str]:
    """Digests of a trial's recordings and of its samples."""
    trial = read_trial(path)
    recordings = [file["sha256"] for file in trial.provenance["files"].values()]
    return {
        "trial": path.stem,
        "recordings": hashlib.sha256("".join(recordings).encode()).hexdigest()[:16],
        "samples": digest_of(trial.samples),
    }


def main() -> str | None:
    """Compare, or keep with `--keep`; a text says what differs."""
    today = pl.DataFrame(
        [row_of(path) for path in sorted(Path("results/trials").glob("*.parquet"))]
    )
    if "--keep" in sys.argv:
        today.write_csv(KEPT)
        return None

    kept = pl.read_csv(KEPT)
    missing = kept.join(today, on="trial", how="anti")["trial"].to_list()
    both = kept.join(today, on=["trial", "recordings"], suffix="_today")
    changed = both.filter(pl.col("samples") != pl.col("samples_today"))["trial"].to_list()
    print(f"{len(both) - len(changed)} of {len(kept)} trials equal; ", end="")
    print(f"{len(kept) - len(both)} of other recordings, not compared")
    if missing or changed:
        return f"missing: {missing}; samples differ from {KEPT.name}: {changed}"
    return None


if __name__ == "__main__":
    sys.exit(main())
