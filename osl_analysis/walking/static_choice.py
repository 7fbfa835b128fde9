"""Which static trial calibrates a trial: the one that its row of the sheet names, else that of the same conditions."""

from collections.abc import Mapping

from osl_analysis.errors import InputError, listing
from osl_analysis.walking.conditions import Cells, shown, written

SHARED = ("subject", "session", "side")
"""Conditions that a trial shares with its static trial. An empty cell matches every value."""
STATIC = "static"
"""Column of the sheet that names the static trial of a trial."""


def static_of(trial: str, cells: Cells, statics: Mapping[str, Cells]) -> str:
    """Name of the static trial of a trial whose row is `cells`; `statics` are the rows of the static trials by name.

    The row's column `static` decides. Without it, the static trials that contradict no stated subject, session or side
    are candidates, and of these the one that agrees in the most. The only candidate of a sheet is taken even if nothing
    is stated.

    Raises
    ------
    InputError
        The named trial is not a static trial that is used, or the candidates are none or several.
    """
    named = cells.get(STATIC)
    if named is not None:
        if named not in statics:
            raise InputError(
                f"trial '{trial}', static: '{named}' is no trial of experiment 'static' that is used; the sheet has "
                f"{listing(list(statics))}"
            )
        return str(named)
    agreement = {name: agreeing(cells, other) for name, other in statics.items()}
    most = max((count for count in agreement.values() if count is not None), default=None)
    best = [name for name, count in agreement.items() if count is not None and count == most]
    if len(best) == 1:
        return best[0]
    stated = ", ".join(f"{key} {shown(cells[key])}" for key in SHARED if cells.get(key) is not None)
    whose = f" ({stated})" if stated else ", which states no subject, session or side"
    if not best:
        raise InputError(
            f"trial '{trial}'{whose}: no static trial of the same conditions, the sheet has {listing(list(statics))}; "
            "record one, or name one in the column static"
        )
    raise InputError(
        f"trial '{trial}'{whose}: {len(best)} static trials could be its own ({listing(best)}); name one in the column "
        "static, or state subject, session or side of all of them"
    )


def agreeing(cells: Cells, other: Cells) -> int | None:
    """Number of conditions that both rows state alike; None if they contradict each other."""
    pairs = [(cells.get(key), other.get(key)) for key in SHARED]
    both = [(a, b) for a, b in pairs if a is not None and b is not None]
    return len(both) if all(a == b for a, b in both) else None


def side_of(static: str, cells: Cells, served: Mapping[str, Cells], otherwise: str) -> str:
    """Side of the leg that a static trial calibrates: of its own row, else of the trials that it serves, else
    `otherwise`.

    Raises
    ------
    InputError
        It serves trials of both sides, or of another side than its own.
    """
    sides = {row["side"]: name for name, row in served.items() if row.get("side") is not None}
    own = cells.get("side")
    wrong = [(side, name) for side, name in sides.items() if own is not None and side != own]
    if len(sides) > 1 or wrong:
        side, name = wrong[0] if wrong else list(sides.items())[1]
        raise InputError(
            f"static trial '{static}' serves trials of the sides {written({*sides, own} - {None})} (trial '{name}': "
            f"{side}); record a static trial for each side and state its side"
        )
    return str(own or next(iter(sides), otherwise))
