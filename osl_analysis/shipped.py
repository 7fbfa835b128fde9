"""The files that come with the program beside its modules: the workflow, and the configuration that campaigns override.

In a clone they stand at its top level. In an installed package they stand in its folder `shipped`, where the build of
the wheel puts them (`pyproject.toml`).
"""

from pathlib import Path

PACKAGE = Path(__file__).parent


def root() -> Path:
    """The folder of the shipped files."""
    installed = PACKAGE / "shipped"
    return installed if installed.is_dir() else PACKAGE.parent


def shipped(path: Path | str) -> Path:
    """A path as it is if it is there, seen from the working folder; else the shipped file or folder of this name.

    A path that is neither stays as it is, for the message that it is missing.
    """
    own, theirs = Path(path), root() / path
    return theirs if not own.exists() and theirs.exists() else own


CAMPAIGN = Path("config.yaml")
"""The configuration in the folder of a campaign, as `osl-analysis init` writes it."""


def config_here() -> Path:
    """The configuration of the campaign in the working folder; the default one where there is none."""
    return CAMPAIGN if CAMPAIGN.is_file() else default_config()


def default_config() -> Path:
    """The default configuration, which a campaign's own overrides."""
    return shipped("config/config.yaml")
