"""Topics with stamps of their own as one table: the rows of a full join, sorted by the stamp."""

import numpy as np
import polars as pl
import pytest

from osl_analysis.ingest.message_log import joined_on_stamp


def topic(rng: np.random.Generator, *names: str) -> pl.DataFrame:
    """Some of sixty stamps, with columns of which some values are NaN and some null, and a counter."""
    stamp = np.sort(rng.choice(60, rng.integers(3, 40), replace=False)).astype(np.int64)
    columns = {name: np.where(rng.random(len(stamp)) < 0.1, np.nan, rng.standard_normal(len(stamp))) for name in names}
    null = pl.Series(rng.random(len(stamp)) < 0.1)
    made = {name: pl.Series(values).set(null, None) for name, values in columns.items()}
    return pl.DataFrame({"stamp": stamp, **made, f"{names[0]}_counter": np.arange(len(stamp))})


@pytest.mark.parametrize("seed", range(10))
def test_topics_are_joined_as_by_a_full_join_that_is_sorted(seed):
    rng = np.random.default_rng(seed)
    tables = [topic(rng, "theta", "current"), topic(rng, "torque"), topic(rng, "command")]
    expected = tables[0]
    for table in tables[1:]:
        expected = expected.join(table, on="stamp", how="full", coalesce=True)
    found = joined_on_stamp([table.clone() for table in tables])
    assert found.schema == expected.schema
    assert found.equals(expected.sort("stamp"), null_equal=True)


def test_topics_of_the_same_stamps_share_their_rows():
    stamp = np.array([3, 5, 9])
    tables = [pl.DataFrame({"stamp": stamp, name: stamp * 0.5}) for name in ("a", "b")]
    assert joined_on_stamp(tables).columns == ["stamp", "a", "b"]
    assert len(joined_on_stamp(tables)) == 3
