"""Parts of captions, in Markdown: names from files, and which of the drawn fits are doubtful."""

import re
from collections.abc import Iterable, Sequence

import polars as pl

from osl_analysis.figures import names
from osl_analysis.judge.causes import BETWEEN
from osl_analysis.stats.repeats import IS_DOUBTFUL


def as_text(name: str) -> str:
    """A name from a file, of which Markdown shows every sign. Some dialects join repeated hyphens
    and dots."""
    # signs of Markdown; links, also of bare addresses; the second of two hyphens or dots
    special = r"[\\`*_{}\[\]<>#|~$&!^@\"']|:(?=//)|(?<=-)-|(?<=\.)\.|(?<=www)\."
    plain = " ".join(re.sub(r"[\x00-\x1f\x7f\u2028\u2029]", " ", name).split())
    return re.sub(special, lambda sign: f"\\{sign[0]}", plain)


MOST_LISTED = 6  # names in a caption; the tables have all


def listed_text(names: Iterable[str]) -> str:
    """Names from files, each once; of many the first ones, and how many more."""
    texts = [as_text(name) for name in dict.fromkeys(names)]
    listed = ", ".join(texts[:MOST_LISTED])
    n_more = len(texts) - MOST_LISTED
    return f"{listed} and {n_more} more" if n_more > 0 else listed


def doubtful_sentence(table: pl.DataFrame) -> str:
    """Say which of the drawn trials, or groups of crossings, are doubtful, and why; empty where
    nothing was judged."""
    if "doubtful" not in table.columns:
        return ""
    judged = table.drop_nulls("doubtful")
    if judged.is_empty():
        return ""
    named = [pl.col(name) for name in ("trial", "trials") if name in table.columns]
    owners = list(named)
    if "group" in table.columns:
        owners.append(pl.format("mean response of {}", "group"))
    judged = judged.with_columns(owner=pl.coalesce(owners))
    doubtful = judged.filter(IS_DOUBTFUL).unique("owner", maintain_order=True)
    if doubtful.is_empty():
        return "No fit is doubtful."

    # a sound mean response is not counted among the trials
    counted = judged.filter(pl.coalesce(named).is_not_null() | IS_DOUBTFUL)
    of_all = f"{len(doubtful)} of {counted['owner'].n_unique()}"
    by_cause: dict[str, list[str]] = {}
    for owner, cell in doubtful.select("owner", "doubtful").iter_rows():
        for cause in cell.split(BETWEEN):
            by_cause.setdefault(cause, []).append(owner)
    sentences = [f"Doubtful: {of_all}."]
    for cause, of_cause in by_cause.items():
        sentences.append(f"For {as_text(cause)}: {'; '.join(owner_texts(counted, of_cause))}.")
    return " ".join(sentences)


MOST_OWNERS = 6  # trials of one cause that a caption names


def owner_texts(judged: pl.DataFrame, owners: Sequence[str]) -> list[str]:
    """Name some trials, or mean responses, by their conditions in Markdown.

    Parameters
    ----------
    judged : DataFrame
        All of them, with `owner`, and `controller`, `K_d` and `B_d` where these are known.
    owners : sequence of str
        Those to name. All of one controller are named together; of more than `MOST_OWNERS` others
        the first ones, and how many more.
    """
    table = names.completed(judged.with_columns(trial="owner"), ("controller", "K_d", "B_d"))
    table = table.unique("trial", maintain_order=True)
    texts = []
    others = list(owners)
    for (controller,), rows in table.partition_by(
        "controller", as_dict=True, maintain_order=True
    ).items():
        of_controller = rows["trial"].to_list()
        if controller is not None and len(rows) > 1 and set(of_controller) <= set(owners):
            texts.append(f"all {len(rows)} {as_text(controller)}")
            others = [owner for owner in others if owner not in of_controller]
    titles = names.trial_titles(table, written=as_text)
    texts += [titles[owner] for owner in others[:MOST_OWNERS]]
    if len(others) > MOST_OWNERS:
        texts.append(f"{len(others) - MOST_OWNERS} more")
    return texts
