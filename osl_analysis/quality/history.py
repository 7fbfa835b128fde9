"""What ingest had to say about a trial: its clocks, and the damage of its log."""

from typing import Any

from osl_analysis.quality.finding import Finding, not_applicable
from osl_analysis.trial import Trial


def check_clock(trial: Trial) -> Finding:
    """RMS residual [s] of the clock fit, with what else is known of it."""
    clock = trial.provenance.get("clock")
    if not clock:
        return not_applicable("one clock")
    ppm, error = 1e6 * clock["drift"], 1e6 * clock["drift_error"]
    outside = f"{clock.get('rows_before', 0)} and {clock.get('rows_after', 0)} rows of the log before and after"
    matched = f"{clock['edges']} matched and {clock['left_out']} left out by {clock.get('method', 'edges')}"
    return Finding(clock["residual"], f"drift {ppm:.1f} +- {error:.1f} ppm; {matched}; {outside} motion capture")


def check_damage(trial: Trial) -> Finding:
    """Share of the log [%] that was lost to damage."""
    damage = damage_report(trial)
    if not damage:
        return not_applicable("no damage report")
    said = [f"{damage[key]} {key.replace('_', ' ')}" for key in ("chunks_lost", "messages_lost") if damage.get(key)]
    said += [] if damage.get("complete", True) else ["the file is not complete"]
    said += [f"CRC {damage['crc']}"] if damage.get("crc") else []
    remarks = damage.get("remarks") or []
    said += [remarks] if isinstance(remarks, str) else [str(remark) for remark in remarks]
    return Finding(100 * float(damage.get("share_lost") or 0.0), "; ".join(said))


def check_unfinished(trial: Trial) -> Finding:
    """Logs without their end: what a crash or a cut took with it does not show in the share that was lost."""
    damage = damage_report(trial)
    if not damage:
        return not_applicable("no damage report")
    complete = damage.get("complete", True)
    return Finding(
        0.0 if complete else 1.0, "" if complete else "no end: see whether the trial lasts as long as it should"
    )


def damage_report(trial: Trial) -> dict[str, Any]:
    """What ingest says of the damage to the log; empty where it says nothing."""
    return dict(trial.provenance.get("damage") or trial.provenance.get("log", {}).get("damage") or {})
