"""Which part of a message says what is wrong, and which what to do.

A message of this program is "what is wrong; what to do". Both parts may have semicolons of their own. The second one
begins with a verb in the imperative. Where no part does, the whole message is the reason.
"""

import re

REMEDIES = {
    "refused": "correct or replace the file, or its source file, or give a reason under `exclude` in the sample sheet",
    "failed": "a fault of this program: report it with the traceback in {log}; the next run tries it again",
    "died": "run again; if memory was short, with fewer jobs at once (`--cores 1`)",
}
"""What to do after each outcome of a job, where its message does not say; `log` is the path of its log."""
NO_ACCESS = "make the file or its folder accessible, or room on the disk; the next run tries it again"
"""After an error of the system."""
OF_SEVERAL = "correct or exclude the trials behind it, or change the settings of this analysis in the configuration"
"""Where a result over several trials is refused with a message that says nothing of what to do."""
TO_DO = frozenset({
    "add", "ask", "calibrate", "check", "choose", "clear", "convert", "copy", "correct", "cut", "delete", "drive",
    "enable", "exclude", "excite", "export", "fill", "find", "fit", "give", "ingest", "keep", "label", "leave",
    "list", "look", "lower", "make", "map", "mark", "mend", "move", "name", "put", "quote", "raise", "rebuild",
    "record", "remove", "rename", "repair", "repeat", "replace", "resample", "rewrite", "run", "sample", "save",
    "see", "select", "set", "shorten", "start", "state", "switch", "synchronise", "synchronize", "take", "turn",
    "type", "use", "wait", "write", "zero",
})  # fmt: skip
"""Verbs with which a remedy begins."""
BREAK = re.compile(r"; ")


def reason_and_remedy(message: str) -> tuple[str, str]:
    """The two parts of a message; the remedy is empty where none can be told from the reason.

    The remedy begins at the first semicolon outside brackets after which a verb of `TO_DO` stands.
    """
    for found in BREAK.finditer(message):
        reason, rest = message[: found.start()], message[found.end() :]
        outside = all(reason.count(left) == reason.count(right) for left, right in ("()", "[]"))
        if outside and is_to_do(rest):
            return reason, rest
    return message, ""


def is_to_do(text: str) -> bool:
    """Whether a text begins with what to do: a verb of `TO_DO`, also after "if ...," or "for ...,"."""
    condition = re.match(r"(?:if|for|to) [^;,]*, ", text)
    first = re.match(r"[A-Za-z]+", text[condition.end() :] if condition else text)
    return first is not None and first[0].lower() in TO_DO
