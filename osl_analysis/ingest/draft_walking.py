"""A draft of the section `walking` of a configuration, from the names of a capture's markers."""

import json
import re
from collections.abc import Iterable, Sequence

import numpy as np

from osl_analysis.ingest.draft_places import UNKNOWN
from osl_analysis.ingest.overview import Overview

CLUSTERS = {
    "foot": r"FOOT|SHOE|HEEL|CALC|TOE|META?\d",
    "shank": r"SHANK|SHIN|TIB|PYLON|LEG",
    "platform": r"PLAT|HEXAPOD|STEWART",
}
"""What names of markers contain, by cluster."""
ANKLE = r"ANK|MALL?"
SIDES = {"ankle_medial": r"MED|(^|_)M(_|MAL|$)", "ankle_lateral": r"LAT|(^|_)L(_|MAL|$)"}
"""What the names of the malleoli contain, both."""
FEWEST = 3
LOADED = 100.0
"""Range of the force [N] above which somebody stepped on a plate."""
TITLE = "Draft of the section `walking` of the configuration, guessed from the names of markers. Check every line."


def draft_walking(overview: Overview) -> list[str]:
    """Lines of YAML as comments, so that they can stand below the draft of a source file.

    None unless markers are named as a platform's and as a foot's or shank's. What names do not tell is UNKNOWN.
    """
    labels = list(dict.fromkeys(c.address["label"] for c in overview.channels if c.kind == "marker"))
    malleoli = {key: [n for n in labels if contains(n, ANKLE) and contains(n, word)] for key, word in SIDES.items()}
    free = [name for name in labels if not any(name in names for names in malleoli.values())]
    clusters = {key: [name for name in free if contains(name, word)] for key, word in CLUSTERS.items()}
    if not clusters["platform"] or not (clusters["foot"] or clusters["shank"]):
        return []
    lines = [
        TITLE,
        "walking:",
        "  side: UNKNOWN  # left or right: the leg that steps on the platform",
        f"  plate: {plate_text(overview, clusters['platform'])}",
        "  markers:",
        *(f"    {key}: {cluster_text(names)}" for key, names in clusters.items()),
        *(f"    {key}: {malleolus_text(names)}" for key, names in malleoli.items()),
    ]
    return [f"# {line}" for line in lines]


def plate_text(overview: Overview, platform: Sequence[str]) -> str:
    """The number of the plate on the platform in YAML; of several a guess that is said to be one, or UNKNOWN.

    The guess is the plate with load; of several with load the one nearest to the platform's markers.
    """
    plates = [channel for channel in overview.channels if channel.kind == "plate"]
    if len(plates) == 1:
        return "1"
    loaded = [plate for plate in plates if (plate.load or 0.0) > LOADED]
    if not loaded:
        return f"{UNKNOWN}  # of {len(plates)} force plates in this file: the one on the platform"
    own = [c for c in overview.channels if c.kind == "marker" and c.address["label"] in platform and c.centre]
    if own and len(loaded) > 1:
        place = np.mean([marker.centre for marker in own], axis=0)
        guess = min(loaded, key=lambda plate: float(np.linalg.norm(np.asarray(plate.centre) - place)))
        why = "with load the one that is nearest to the platform's markers"
    else:
        guess = max(loaded, key=lambda plate: plate.load or 0.0)
        why = "the one with the load"
    return f"{guess.address['plate']}  # a guess, to be confirmed: of {len(plates)} force plates {why}"


def contains(label: str, word: str) -> bool:
    """Whether a label contains the pattern; the name of the subject before a colon does not count."""
    return re.search(word, label.rpartition(":")[2].upper()) is not None


def cluster_text(names: Iterable[str]) -> str:
    """The labels of a cluster in YAML, with a remark if they are too few."""
    found = [json.dumps(name) for name in names]
    few = f"  # UNKNOWN: a cluster has {FEWEST} or more" if len(found) < FEWEST else ""
    return f"[{', '.join(found)}]{few}"


def malleolus_text(names: list[str]) -> str:
    """The label of one malleolus in YAML, or what is to be stated."""
    if len(names) == 1:
        return json.dumps(names[0])
    several = f"one of {', '.join(json.dumps(name) for name in names)}" if names else "named in the static trial"
    return f"UNKNOWN  # {several}"
