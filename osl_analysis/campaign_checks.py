"""What a campaign is refused for before any job: missing files, unfit quality rules, trials that walking lacks."""

from pathlib import Path

from osl_analysis.campaign import Campaign
from osl_analysis.errors import InputError
from osl_analysis.quality.verdict import CHECKS, unknown_check, validate_rules
from osl_analysis.walking.conditions import split_keys


def check_campaign(campaign: Campaign) -> None:
    """Refuse a configuration that names a missing file, and walking trials whose analysis lacks other trials."""
    check_files(campaign)
    check_quality(campaign)
    check_walking(campaign)


def check_files(campaign: Campaign) -> None:
    """Refuse a configuration that names a missing file, or a file for the results' folder. Raw files are checked
    when they are ingested.
    """
    config = campaign.config
    for folder in (config.results, *config.results.parents):
        if folder.exists() and not folder.is_dir():
            raise InputError(f"{folder}: is a file; name a folder under `results` in the configuration")
    if config.results == Path():
        raise InputError("configuration: results is empty, or this very folder; name a folder, as `results: results`")
    named = {
        "parameters": config.parameters,
        "impedance_trajectory": config.impedance_trajectory,
        "study.simulation": config.study.simulation,
    }
    for field, path in named.items():
        if path is not None and not path.is_file():
            none = ", or write null for none" if field != "study.simulation" else ""
            raise InputError(f"{path}: no such file; correct {field} in the configuration{none}")


def check_quality(campaign: Campaign) -> None:
    """Refuse quality rules that do not match the checks, and names under `accept` that are not checks."""
    validate_rules(campaign.config.quality)
    for trial in campaign.sheet.index:
        unknown = [name for name in campaign.accepted(trial) if name not in CHECKS]
        if unknown:
            raise InputError(f"{campaign.config.sheet}: trial '{trial}', accept: {unknown_check(unknown[0])}")


def check_walking(campaign: Campaign) -> None:
    """Refuse walking trials without the static, plate and other trials that their analysis needs."""
    if not campaign.trials("walking"):
        return
    fewest = campaign.config.walking.fewest_unperturbed
    needs = {
        "trial of experiment 'static'": (len(campaign.trials("static")), 1),
        "unperturbed crossings": (len(campaign.crossings(perturbed=False)), fewest),
        "perturbed crossings": (len(campaign.crossings(perturbed=True)), 2),
    }
    for what, (count, least) in needs.items():
        if count < least:
            raise InputError(
                f"{campaign.config.sheet}: {count} {what}, walking needs {least} or more; add them, or exclude the "
                "walking trials"
            )
    if campaign.config.walking.plate_inertia == "identified" and not campaign.trials("plate"):
        raise InputError(
            f"{campaign.config.sheet}: 0 trial of experiment 'plate' (unloaded platform, moved), walking needs 1 or "
            "more to remove the plate's own inertia; add them, or state `plate_inertia: none` under `walking` if "
            "the plate is light or compensates its inertia itself"
        )
    for static in campaign.statics:
        campaign.calibration_settings(static)
    check_conditions(campaign)


def check_conditions(campaign: Campaign) -> None:
    """Refuse conditions of crossings that the analysis cannot keep apart."""
    try:
        split_keys(campaign.conditions(), campaign.config.walking)
    except InputError as error:
        raise InputError(f"{campaign.config.sheet}: {error}") from error
