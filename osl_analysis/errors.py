"""What can go wrong, as one family: every message names the cause and the remedy, on one line."""


class OslAnalysisError(ValueError):
    """A mistake or a limit that the user can do something about."""


class InputError(OslAnalysisError):
    """A file, channel, field or value is not what it must be."""


class IdentifiabilityError(OslAnalysisError):
    """The data cannot tell the requested parameters apart."""


class UnreachableImpedanceError(OslAnalysisError):
    """No control gains render the requested impedance."""
