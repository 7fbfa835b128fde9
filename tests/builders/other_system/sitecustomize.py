# SPDX-License-Identifier: Apache-2.0
"""A system that lacks what Windows and macOS lack, for a process with this folder in its path.

Names of POSIX are gone. A file cannot be replaced, renamed or deleted while this process has it
open, and no renaming replaces another file. The package opens no text in the encoding of the
system.
"""

import os
import sys
import warnings
from pathlib import Path

for module in ("fcntl", "grp", "pwd", "termios"):
    sys.modules[module] = None  # an import of it fails
for name in ("fork", "forkpty", "getpgid", "killpg", "mkfifo", "sched_getaffinity", "setsid"):
    delattr(os, name)
os.process_cpu_count = os.cpu_count  # as Python 3.13 has it on such a system
os.environ["USERNAME"] = "student"  # Windows sets it
warnings.filterwarnings("ignore", category=EncodingWarning)
warnings.filterwarnings("error", category=EncodingWarning, module=r"osl_analysis")

unlink = os.unlink
replace = os.replace


def check_closed(path: str | Path) -> None:
    """Refuse a file that is open or mapped in this process."""
    real = os.path.realpath(path)
    opened = {os.path.realpath(link) for link in Path("/proc/self/fd").iterdir()}
    if real in opened or f" {real}\n" in Path("/proc/self/maps").read_text():
        raise PermissionError(13, "used by another process", str(path))


def windows_unlink(path, *, dir_fd=None):
    if dir_fd is None:
        check_closed(path)
    unlink(path, dir_fd=dir_fd)


def windows_replace(source, target):
    check_closed(source)
    check_closed(target)
    replace(source, target)


def windows_rename(source, target):
    if os.path.lexists(target):
        raise FileExistsError(17, "exists", str(target))
    check_closed(source)
    replace(source, target)


os.unlink = os.remove = windows_unlink
os.replace = windows_replace
os.rename = windows_rename
