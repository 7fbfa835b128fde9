# SPDX-License-Identifier: Apache-2.0
"""Plant faults in the package, one at a time, and tell which tests die of them.

    python benchmarks/mutants.py --seed 1 [--rooms bench walking] [--mutants 10] [--room-only]

Each room (a package of `osl_analysis`) gets ten mutants, drawn with the seed from its syntax trees:

| kind | before | after |
|---|---|---|
| sign | `a + b`, `a - b`, `-a` | `a - b`, `a + b`, `a` |
| factor | `2 * a`, `a / 2`; `a * b`, `a / b` | `a`; `a / b`, `a * b` |
| guard | `if a:` without `else`; `a and b`, `a or b` | `if False:`; `a` |
| arguments | `f(a, b)` | `f(b, a)` |
| threshold | a number in a comparison, a constant's, a field's default | twice as large |
| contribution | `a + b`, `a - b`; `a += b`, `a.append(b)` | `a`; nothing |

The tests of the room run on each mutant until one dies, and the tests of the other rooms on those
that survive. All of it happens in copies of what Git lists, in a temporary folder. Each row is
written to `build/mutants_SEED.csv` as soon as it is known, and the table is printed at the end.

A mutant that changes no result is no gap in the tests. Those that were looked at stand in
`equivalent_mutants.yaml` with the reason: they are printed, not run, and left out of the shares.
"""

import argparse
import ast
import csv
import importlib.util
import os
import queue
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[1]
EQUIVALENT = Path(__file__).with_name("equivalent_mutants.yaml")
PACKAGE = "osl_analysis"
MUTANTS = 10  # of a room
COPIES = 2  # as many as the cores that `.ci/run` has
SLOWEST_RUN = 5  # durations of the sound run, after which a mutant is taken to hang
SHORTEST_LIMIT_S = 60.0  # a busy machine may need this for the imports alone
LONGEST_SUITE_S = 1800.0  # the suite takes four minutes on one quiet core
KINDS = ("sign", "factor", "guard", "arguments", "threshold", "contribution")
TESTS_OF_ROOM = {"config": ["campaign", "contract"], "dictionary": ["contract"]}
"""Folders of tests of the rooms that have none of their own name."""
SYMMETRIC = frozenset(
    {"hypot", "maximum", "minimum", "max", "min", "isinstance", "print", "gcd", "zip"}
)
"""Functions whose exchanged arguments give the same, or an error at once."""
GROWING = frozenset({"append", "extend", "add", "update"})
SWAPPED = {ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*"}


@dataclass(frozen=True)
class Mutant:
    """A fault in one place.

    Attributes
    ----------
    file : str
        From the project's root.
    line : int
    kind : str
        One of `KINDS`.
    start, stop : int
        The bytes of the file that are replaced.
    before, after : str
        Their text, and what replaces it.
    """

    file: str
    line: int
    kind: str
    start: int
    stop: int
    before: str
    after: str

    @property
    def change(self) -> str:
        """The replacement on one line."""
        return " ".join(f"{self.before} → {self.after or '(left out)'}".split())

    def apply(self, source: bytes) -> bytes:
        """Return the source with the fault."""
        return source[: self.start] + self.after.encode() + source[self.stop :]


@dataclass(frozen=True)
class Death:
    """How a run of tests on a mutant ended: the test that died first, or "" where all lived."""

    test: str
    duration_s: float


class Module:
    """The syntax tree of a file, and the mutants that can be made of it."""

    def __init__(self, root: Path, file: str) -> None:
        self.file = file
        self.source = (root / file).read_bytes()
        self.tree = ast.parse(self.source)
        lines = self.source.splitlines(keepends=True)
        self.line_starts = [0]
        for line in lines:
            self.line_starts.append(self.line_starts[-1] + len(line))

    def start(self, node: ast.AST) -> int:
        """Return the first byte of a node."""
        return self.line_starts[node.lineno - 1] + node.col_offset

    def stop(self, node: ast.AST) -> int:
        """Return the byte after a node."""
        return self.line_starts[node.end_lineno - 1] + node.end_col_offset

    def text(self, node: ast.AST) -> str:
        """Return the source of a node."""
        return self.source[self.start(node) : self.stop(node)].decode()

    def replaced(self, kind: str, node: ast.AST, after: str) -> Mutant:
        """Return the mutant that has other text for a node."""
        place = (self.start(node), self.stop(node))
        return Mutant(self.file, node.lineno, kind, *place, self.text(node), after)

    def mutants(self) -> Iterator[Mutant]:
        """Yield all mutants of the file, in the order of its lines."""
        for node in computing_nodes(self.tree):
            if isinstance(node, ast.BinOp):
                yield from self.operation_mutants(node)
            elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
                yield self.replaced("sign", node, self.text(node.operand))
            elif isinstance(node, ast.If) and not node.orelse:
                yield self.replaced("guard", node.test, "False")
            elif isinstance(node, ast.BoolOp):
                yield self.replaced("guard", node, f"({self.text(node.values[0])})")
            elif isinstance(node, ast.Call):
                yield from self.call_mutants(node)
            elif isinstance(node, ast.Compare):
                yield from self.doubled_numbers(node.comparators)
            elif isinstance(node, ast.ClassDef):
                fields = [field for field in node.body if isinstance(field, ast.AnnAssign)]
                yield from self.doubled_numbers([field.value for field in fields])
            elif isinstance(node, ast.Assign | ast.AnnAssign) and is_constant(node):
                yield from self.doubled_numbers([node.value])
            elif is_growing(node):
                yield self.replaced("contribution", node, "pass")

    def operation_mutants(self, node: ast.BinOp) -> Iterator[Mutant]:
        """Yield the mutants of a sum, a difference, a product or a quotient."""
        operator = SWAPPED.get(type(node.op))
        if operator is None or is_text_or_list(node.left) or is_text_or_list(node.right):
            return
        left, right = self.text(node.left), self.text(node.right)
        swapped = f"({left}) {operator} ({right})"
        if isinstance(node.op, ast.Add | ast.Sub):
            yield self.replaced("sign", node, f"({swapped})")
            yield self.replaced("contribution", node, f"({left})")
        elif is_number(node.left):
            yield self.replaced("factor", node, f"({right})")
        elif is_number(node.right):
            yield self.replaced("factor", node, f"({left})")
        else:
            yield self.replaced("factor", node, f"({swapped})")

    def call_mutants(self, node: ast.Call) -> Iterator[Mutant]:
        """Yield the mutant whose first two arguments are exchanged."""
        function = node.func
        name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
        first_two = node.args[:2]
        is_plain = all(not isinstance(argument, ast.Starred) for argument in first_two)
        if len(first_two) < 2 or not is_plain or name in SYMMETRIC:
            return
        if any(isinstance(argument, ast.Constant) for argument in first_two):
            return  # a name or a number in the place of an array is an error at once
        first, second = first_two
        between = self.source[self.stop(first) : self.start(second)].decode()
        exchanged = self.text(second) + between + self.text(first)
        start, stop = self.start(first), self.stop(second)
        before = self.source[start:stop].decode()
        if exchanged != before:
            yield Mutant(self.file, first.lineno, "arguments", start, stop, before, exchanged)

    def doubled_numbers(self, nodes: Sequence[ast.expr | None]) -> Iterator[Mutant]:
        """Yield mutants with twice the number, of each of the nodes that is one and not 0."""
        for node in nodes:
            if is_number(node) and node.value:
                yield self.replaced("threshold", node, f"(2 * {self.text(node)})")


def is_number(node: ast.AST | None) -> bool:
    """Return whether a node is a number that is written out."""
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def is_text_or_list(node: ast.AST) -> bool:
    """Return whether a node is certainly a text or a list, of which + and * mean something else."""
    if isinstance(node, ast.BinOp):
        return is_text_or_list(node.left) or is_text_or_list(node.right)
    is_text = isinstance(node, ast.Constant) and isinstance(node.value, str | bytes)
    return is_text or isinstance(node, ast.JoinedStr | ast.List | ast.ListComp | ast.Tuple)


def is_constant(node: ast.Assign | ast.AnnAssign) -> bool:
    """Return whether a statement gives a value to a name in capitals."""
    target = node.targets[0] if isinstance(node, ast.Assign) else node.target
    return isinstance(target, ast.Name) and target.id.isupper()


def is_growing(node: ast.AST) -> bool:
    """Return whether a statement adds to a sum or to a collection."""
    if isinstance(node, ast.AugAssign):
        return isinstance(node.op, ast.Add)
    is_call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
    return is_call and getattr(node.value.func, "attr", "") in GROWING


def computing_nodes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes below one that compute: no annotations, and no words of errors."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "type_params"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST) and not isinstance(child, ast.Raise | ast.JoinedStr):
                yield child
                yield from computing_nodes(child)


def rooms(root: Path) -> list[str]:
    """Return the packages that have code."""
    return sorted({file.parent.name for file in (root / PACKAGE).glob("*/*.py")})


def drawn_mutants(root: Path, room: str, seed: int, number: int = MUTANTS) -> list[Mutant]:
    """Draw mutants of a room, each of another line.

    A kind is drawn first and then a place, so that rare kinds come as often.

    Parameters
    ----------
    root : Path
        The project's folder.
    room : str
        The name of a package in `osl_analysis`.
    seed : int
        The same seed draws the same mutants of the same code.
    number : int

    Returns
    -------
    list of Mutant
        Fewer than `number` where the room has no more lines to change.
    """
    randomness = random.Random(f"{seed} {room}")
    by_kind = defaultdict(list)
    for path in sorted((root / PACKAGE / room).glob("*.py")):
        for mutant in Module(root, str(path.relative_to(root))).mutants():
            by_kind[mutant.kind].append(mutant)
    for places in by_kind.values():
        randomness.shuffle(places)

    drawn = []
    lines_taken = set()
    while len(drawn) < number and any(by_kind.values()):
        kind = randomness.choice([kind for kind in KINDS if by_kind[kind]])
        mutant = by_kind[kind].pop()
        if (mutant.file, mutant.line) not in lines_taken:
            lines_taken.add((mutant.file, mutant.line))
            drawn.append(mutant)
    return sorted(drawn, key=lambda mutant: (mutant.file, mutant.line))


def tests_of(root: Path, room: str) -> list[str]:
    """Return the folders of a room's tests."""
    folders = [f"tests/{folder}" for folder in TESTS_OF_ROOM.get(room, [room])]
    return [folder for folder in folders if (root / folder).is_dir()]


def other_tests(root: Path, room: str) -> list[str]:
    """Return the folders of all other tests."""
    folders = [
        f"tests/{path.name}"
        for path in sorted((root / "tests").iterdir())
        if any(path.glob("test_*.py"))
    ]
    return [folder for folder in folders if folder not in tests_of(root, room)]


def copied_project(root: Path, folder: Path) -> Path:
    """Copy what Git lists of a project into a folder, as a repository of its own."""
    folder.mkdir()
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=root, capture_output=True, text=True, check=True
    )
    for name in filter(None, listed.stdout.split("\0")):
        if (root / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, folder / name, follow_symlinks=False)
    subprocess.run(["git", "init", "-q"], cwd=folder, check=True)
    subprocess.run(["git", "add", "-A", "-f"], cwd=folder, check=True)
    return folder


def run_tests(copy: Path, folders: Sequence[str], limit_s: float | None = None) -> Death:
    """Run tests until the first dies.

    Returns
    -------
    Death
        With the test that died, "(hangs)" after the limit, or the last words of a run that names
        no test.
    """
    environment = {**os.environ, "PYTHONPATH": str(copy)}
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-n0",
        "-x",
        "-q",
        "--tb=no",
        "-rfE",
        "-p",
        "no:cacheprovider",
    ]
    began = time.monotonic()
    with subprocess.Popen(
        [*command, *folders],
        cwd=copy,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            output, _ = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)  # with the campaigns that tests have started
            process.communicate()
            return Death("(hangs)", time.monotonic() - began)
    duration_s = time.monotonic() - began
    if process.returncode == 0:
        return Death("", duration_s)
    killer = re.search(r"^(?:FAILED|ERROR) (\S+)", output, re.MULTILINE)
    last_words = " ".join(output.split())[-100:]
    return Death(
        killer[1] if killer else f"(exit code {process.returncode}: {last_words})", duration_s
    )


def write_source(path: Path, source: bytes) -> None:
    """Write a module, and delete what Python compiled of it before.

    Python takes a change of the same length within a second for none.
    """
    path.write_bytes(source)
    Path(importlib.util.cache_from_source(str(path))).unlink(missing_ok=True)


def death_of(copy: Path, mutant: Mutant, folders: Sequence[str], limit_s: float) -> Death:
    """Run tests on a mutant in a copy, and take the fault out again."""
    path = copy / mutant.file
    sound = path.read_bytes()
    write_source(path, mutant.apply(sound))
    try:
        return run_tests(copy, folders, limit_s)
    finally:
        write_source(path, sound)


def reason_of_equivalence(mutant: Mutant) -> str:
    """Return why a mutant changes no result, or "" where that is not known."""
    listed = yaml.safe_load(EQUIVALENT.read_text("utf-8")) or []
    for entry in listed:
        if (entry["file"], entry["change"]) == (mutant.file, mutant.change):
            return entry["reason"]
    return ""


@dataclass(frozen=True)
class Row:
    """What became of a mutant, and the test that killed it, or why it is equivalent."""

    room: str
    mutant: Mutant
    outcome: str
    test: str

    def cells(self) -> list[str]:
        """Return the cells of the table."""
        mutant = self.mutant
        return [
            self.room,
            f"{mutant.file}:{mutant.line}",
            mutant.kind,
            mutant.change,
            self.outcome,
            self.test,
        ]


COLUMNS = ["room", "place", "kind", "mutation", "outcome", "test that kills"]
ROOM, SUITE, EQUAL, ALIVE_IN_ROOM, ALIVE = (
    "room",
    "suite",
    "equivalent",
    "alive in its room",
    "alive",
)


@dataclass(frozen=True)
class Plan:
    """What is drawn and run.

    Attributes
    ----------
    root : Path
        The project's folder, a repository of Git.
    seed : int
    rooms : sequence of str
    number : int
        Mutants of a room.
    copies : int
        In so many copies of the project tests run at a time.
    room_only : bool
        Whether survivors of their room are left at that.
    """

    root: Path
    seed: int
    rooms: Sequence[str]
    number: int = MUTANTS
    copies: int = COPIES
    room_only: bool = False

    def rows(self) -> Iterator[Row]:
        """Yield a row for each mutant, room by room.

        Raises
        ------
        SystemExit
            If the tests of a room fail without a fault.
        """
        with (
            tempfile.TemporaryDirectory(prefix="mutants_") as folder,
            ThreadPoolExecutor(self.copies) as pool,
        ):
            copies: queue.Queue[Path] = queue.Queue()
            for place in range(self.copies):
                copies.put(copied_project(self.root, Path(folder) / str(place)))
            for room in self.rooms:
                copy = copies.get()
                mutants = drawn_mutants(copy, room, self.seed, self.number)
                sound = run_tests(copy, tests_of(copy, room))
                copies.put(copy)
                if sound.test:
                    sys.exit(f"{room}: {sound.test} fails without a fault. Mend it first.")
                limit_s = max(SHORTEST_LIMIT_S, SLOWEST_RUN * sound.duration_s)
                yield from pool.map(partial(self.row, copies, room, limit_s), mutants)

    def row(self, copies: "queue.Queue[Path]", room: str, limit_s: float, mutant: Mutant) -> Row:
        """Tell what kills a mutant, in the next copy that is free."""
        reason = reason_of_equivalence(mutant)
        if reason:
            return Row(room, mutant, EQUAL, reason)
        copy = copies.get()
        try:
            in_room = death_of(copy, mutant, tests_of(copy, room), limit_s)
            if in_room.test:
                return Row(room, mutant, ROOM, in_room.test)
            if self.room_only:
                return Row(room, mutant, ALIVE_IN_ROOM, "")
            elsewhere = death_of(copy, mutant, other_tests(copy, room), LONGEST_SUITE_S)
            return Row(room, mutant, SUITE if elsewhere.test else ALIVE, elsewhere.test)
        finally:
            copies.put(copy)


def table(rows: Sequence[Row]) -> str:
    """Return rows as Markdown, with the shares that died."""
    lines = [f"| {' | '.join(COLUMNS)} |", "|" + "---|" * len(COLUMNS)]
    for row in rows:
        cells = [cell.replace("|", r"\|") for cell in row.cells()]
        lines.append(f"| {' | '.join(cells)} |")
    counted = [row for row in rows if row.outcome != EQUAL]
    in_room = sum(row.outcome == ROOM for row in counted)
    in_suite = in_room + sum(row.outcome == SUITE for row in counted)
    lines += [
        "",
        f"Of {len(counted)} mutants {in_room} die in their room, {in_suite} in all that was run.",
        f"{len(rows) - len(counted)} more are equivalent.",
    ]
    return "\n".join(lines)


def main() -> None:
    """Draw, run, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--rooms", nargs="+", default=rooms(ROOT), metavar="ROOM")
    parser.add_argument("--mutants", type=int, default=MUTANTS, help="of each room")
    parser.add_argument("--room-only", action="store_true", help="without the suite for survivors")
    parser.add_argument("--copies", type=int, default=COPIES, help="in which tests run at a time")
    options = parser.parse_args()
    plan = Plan(
        root=ROOT,
        seed=options.seed,
        rooms=options.rooms,
        number=options.mutants,
        copies=options.copies,
        room_only=options.room_only,
    )

    output = ROOT / f"build/mutants_{options.seed}.csv"
    output.parent.mkdir(exist_ok=True)
    rows = []
    with output.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(COLUMNS)
        try:
            for row in plan.rows():
                rows.append(row)
                writer.writerow(row.cells())
                file.flush()
        finally:
            print(table(rows))


if __name__ == "__main__":
    main()
