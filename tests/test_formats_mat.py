"""MATLAB files: scipy's and h5py's files are read as written, and no file gets more than its size
justifies."""

import struct
import sys
import zlib
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io

from osl_analysis.commands.trials import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.old_formats.mat import checked_address, open_mat

HEADER5 = b"MATLAB 5.0 MAT-file, made for a test".ljust(124) + b"\x00\x01IM"
HEADER73 = b"MATLAB 7.3 MAT-file, made for a test".ljust(124) + b"\x00\x02IM"


def write_mat(path: Path, **variables: object) -> Path:
    """A file of version 5."""
    scipy.io.savemat(path, variables, do_compression=True)
    return path


def part(kind: int, content: bytes) -> bytes:
    """A part of version 5 with its tag, padded."""
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(name: str, kind: int, rows: int, columns: int, content: bytes) -> bytes:
    """A matrix of version 5 with its tag, which may declare what it does not hold."""
    head = (
        part(6, struct.pack("<II", kind, 0))
        + part(5, struct.pack("<2i", rows, columns))
        + part(1, name.encode())
    )
    return part(14, head + content)


def opaque(name: str, class_name: str) -> bytes:
    """An object of a class of MATLAB's own, such as a table."""
    names = b"".join(part(1, text.encode()) for text in (name, "MCOS", class_name))
    inside = matrix("", 13, 2, 1, part(6, struct.pack("<II", 0xDD000000, 2)))
    return part(14, part(6, struct.pack("<II", 17, 0)) + names + inside)


def write_parts(path: Path, *parts: bytes) -> Path:
    """A file of version 5 of these parts."""
    path.write_bytes(HEADER5 + b"".join(parts))
    return path


def write_mat73(path: Path, **variables: object) -> Path:
    """A file of version 7.3: dicts become structs, lists of dicts arrays of structs, tuples cells,
    str text."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            put(file, name, value)
    with path.open("r+b") as raw:
        raw.write(HEADER73)
    return path


def put(group: h5py.Group, name: str, value: object) -> h5py.Group | h5py.Dataset:
    """One value of a file of version 7.3."""
    kind = {dict: "struct", list: "struct", tuple: "cell", str: "char"}.get(type(value), "double")
    if isinstance(value, dict):
        item = group.create_group(name)
        for field, content in value.items():
            put(item, field, content)
    elif isinstance(value, list):
        item = group.create_group(name)
        for field in value[0]:
            item.create_dataset(field, data=referred(group.file, [one[field] for one in value]))
    elif isinstance(value, tuple):
        item = group.create_dataset(name, data=referred(group.file, value))
    elif isinstance(value, str):
        item = group.create_dataset(
            name, data=np.array([[ord(sign)] for sign in value], dtype=np.uint16)
        )
    else:
        stored = np.atleast_2d(np.asarray(value)).T
        if stored.dtype.kind == "c":
            stored = stored.astype(np.complex128).view([("real", "f8"), ("imag", "f8")])
        item = group.create_dataset(name, data=stored)
    item.attrs["MATLAB_class"] = np.bytes_(kind)
    return item


def referred(file: h5py.File, values: Iterable[object]) -> np.ndarray:
    """References to values among `#refs#`, in a column; of four in two, 2x2."""
    group = file.require_group("#refs#")
    made = np.array(
        [put(group, f"r{len(group)}", value).ref for value in values], dtype=h5py.ref_dtype
    )
    return made.reshape(-1, 2 if len(made) == 4 else 1)


RISING = np.arange(12.0)
INSIDE = {"data": np.column_stack([RISING, RISING**2]), "truth": RISING.astype(np.int16)}
CONTENT = {
    "Test": {"slow": {"note": "left", "torque": RISING}, **INSIDE},
    "row": RISING[np.newaxis],
}
RUNS = [{"name": "slow", "torque": RISING}, {"name": "fast", "torque": 2 * RISING}]


def written5(path: Path) -> Path:
    cell = np.empty((1, 2), dtype=object)
    cell[0, 0], cell[0, 1] = RISING, {"torque": -RISING}
    runs = np.array(
        [[tuple(run.values()) for run in RUNS]], dtype=[(name, object) for name in RUNS[0]]
    )
    return write_mat(path, **CONTENT, runs=runs, cells=cell)


def written73(path: Path) -> Path:
    return write_mat73(path, **CONTENT, runs=RUNS, cells=(RISING, {"torque": -RISING}))


def at(path: Path, text: str) -> np.ndarray:
    return open_mat(path).signals([text])[text][1]


def refusal(path: Path, text: str) -> str:
    with pytest.raises(InputError, match=r"^[^\n]+$") as caught:
        at(path, text)
    return str(caught.value)


NUMBERS = {
    "Test.slow.torque": RISING, "Test.data(:,2)": RISING**2, "Test.data(4,:)": [3.0, 9.0],
    "Test.truth": RISING,
    "row": RISING, "runs( 2 ).torque": 2 * RISING, "cells{1}": RISING, "cells{2}.torque": -RISING,
}  # fmt: skip
NOWHERE = {
    "Tset.slow": "no variable 'Tset'; it has",
    "Test.slow.torqe": "and has no torqe; it has note, torque, (1); did you mean 'torque'?",
    "Test.slow": "is a 1x1 struct, not numbers; name one of its fields (note, torque)",
    "Test.slow.note": "is a 1x4 char, not real numbers; save it as numbers: `str2double(x)`",
    "Test.data": "is a 12x2 double; choose one column, as Test.data(:,1), or one row",
    "Test.data(:,3)": "Test.data is a 12x2 double and has no (:,3); it has (:,1), (:,2), (1,:)",
    "runs.torque": "runs is a 1x2 struct and has no torque; it has (1), (2)",
    "cells": "name one of its cells, as `{1}`",
    "cells(1)": "cells is a 1x2 cell and has no (1); it has {1}, {2}",
}  # fmt: skip


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("write", [written5, written73])
def test_an_address_in_matlabs_notation_leads_to_the_numbers_or_says_what_is_there(write, tmp_path):
    path = write(tmp_path / "a.mat")
    for address, expected in NUMBERS.items():
        np.testing.assert_array_equal(at(path, address), expected)
    for address, message in NOWHERE.items():
        assert message in refusal(path, address)


@pytest.mark.usefixtures("in_process")
def test_elements_are_counted_column_by_column_as_in_matlab(tmp_path):
    cell, array = np.empty((2, 2), dtype=object), np.zeros((2, 2), dtype=[("x", object)])
    for row, column in np.ndindex(2, 2):
        cell[row, column] = array["x"][row, column] = np.array([row, column, 0.5])
    every = [[0, 0, 0.5], [1, 0, 0.5], [0, 1, 0.5], [1, 1, 0.5]]
    arrays = [np.array(one) for one in every]
    as73 = write_mat73(tmp_path / "b.mat", cells=(*arrays,), structs=[{"x": one} for one in arrays])
    for path in (write_mat(tmp_path / "a.mat", cells=cell, structs=array), as73):
        for address in ("cells{%d}", "structs(%d).x"):
            assert [at(path, address % number).tolist() for number in (1, 2, 3, 4)] == every


@pytest.mark.parametrize(
    "others",
    [
        {"rig": {"load": np.arange(30.0)}},
        {"load": np.arange(30.0)},
        {"rig": [{}, {"load": np.arange(30.0)}]},
    ],
)
def test_the_address_that_a_draft_tells_for_a_variable_of_another_part_is_read_from_within_its_own(
    tmp_path, others
):
    one = {"t": np.arange(50.0), "torque": np.arange(50.0)}
    path = write_mat(tmp_path / "a.mat", slow=one, fast=one, **others)
    (told,) = (text for text in inspect_file(path).open if "of another" in text)
    address = told.split("`")[3]
    assert address.startswith("/")
    ((_, values, _),) = open_mat(path).signals([address], "slow").values()
    np.testing.assert_array_equal(np.ravel(values), np.arange(30.0))


def test_what_is_no_address_is_refused():
    for text in (
        "",
        "2x",
        "a.",
        "a..b",
        ".a",
        "a(0)",
        "a(:,0)",
        "a b",
        "a{x}",
        "a(b=c)",
        "a(1",
        "(2).a",
    ):
        with pytest.raises(InputError, match="no address in a MATLAB file"):
            checked_address(text, inside=False)


def test_an_object_whose_content_is_not_read_is_named_with_its_class(tmp_path, monkeypatch):
    when = zlib.compress(opaque("when", "datetime"), 9)  # not padded
    path = write_parts(
        tmp_path / "a.mat", opaque("results", "table"), struct.pack("<II", 15, len(when)) + when
    )
    assert "results is a 1x1 table, not real numbers; save its numbers in a struct" in refusal(
        path, "results"
    )
    assert "results is a 1x1 table and has no torque; save its" in refusal(path, "results.torque")
    assert open_mat(path).header == "MATLAB 5.0 MAT-file, made for a test"
    old_style = np.array([[(RISING,)]], dtype=[("x", object)])
    fields = write_mat(tmp_path / "b.mat", z=scipy.io.matlab.MatlabObject(old_style, "iddata"))
    np.testing.assert_array_equal(at(fields, "z.x"), RISING)
    assert "z is a 1x1 iddata, not numbers; name one of its fields (x)" in refusal(fields, "z")
    monkeypatch.setitem(sys.modules, "matio", None)
    said = (
        "when is a 1x1 datetime, not real numbers; pip install 'osl-analysis[matlab]', which reads"
        " it, or save its"
    )
    assert said in refusal(path, "when")


def written_by_matio(path: Path, version: str) -> Path:
    """Tables, timetables and other objects, as MATLAB stores them. mat-io writes the times of a
    timetable and no units: a rate, a step, units and what a time has below the ms are put in by
    hand."""
    from matio import save_to_mat
    from matio.utils.matclass import MatlabOpaque, MatlabOpaqueArray
    from matio.utils.matconvert import convert_py_to_mat

    late = (datetime(2026, 11, 23, 8, tzinfo=UTC).timestamp() * 1e3 + 2 * RISING + 0.25j).reshape(
        -1, 1
    )
    columns = pd.DataFrame(
        {"torque": RISING, "theta": -(RISING**2)}, index=pd.to_timedelta(RISING, unit="ms")
    )
    by_rate, by_step = (convert_py_to_mat(columns, "timetable") for _ in range(2))
    table = convert_py_to_mat(columns.reset_index(names="late"), "table")
    for timetable, is_rate in ((by_rate, True), (by_step, False)):
        inside, second = timetable.properties["any"][0, 0], np.array([[np.timedelta64(1, "s")]])
        rule = {
            "origin": 3 * second,
            "specifiedAsRate": is_rate,
            "stepSize": 2 * second,
            "sampleRate": 800.0,
        }
        inside["rowTimes"], inside["varUnits"] = rule, np.array([["N*m", "deg"]], dtype=object)
    table.properties["data"][0, 2] = np.column_stack([RISING, 2 * RISING])
    table.properties["props"][0, 0]["VariableUnits"] = np.array([["", "N*m", "deg"]], dtype=object)
    note = np.array([["left"]], np.dtypes.StringDType())
    several = np.array([MatlabOpaque({"x": factor * RISING}, "run") for factor in (1, 2)]).reshape(
        1, 2
    )
    content = {
        "z": MatlabOpaque({"dataSet": np.column_stack([RISING, -RISING]), "chanNames": "x1",
        "own": columns}, "nldat"),
        "Test": {"when": MatlabOpaque({"data": late}, "datetime"), "plain": RISING, "note": note},
        "times": columns, "rate": by_rate, "step": by_step, "table": table,
        "runs": MatlabOpaqueArray(several, "run"), "unlike": MatlabOpaque({"data": 1.0}, "table"),
    }  # fmt: skip
    save_to_mat(path, content, version=version)
    if version == "v7.3":  # a struct without fields, as MATLAB writes it
        with h5py.File(path, "a") as file:
            del file["Test"].attrs["MATLAB_fields"]
            file["Test"]["bare"] = np.ones(2, np.uint64)
            file["Test"]["bare"].attrs.update(MATLAB_class=np.bytes_("struct"), MATLAB_empty=1)
    return path


OBJECTS = {
    "z.dataSet(:,2)": -RISING, "z.own.Time": RISING / 1e3, "z.own.torque": RISING,
    "Test.plain": RISING,
    "Test.when": 1795420800.00025 + RISING * 2e-3, "times.Time": RISING / 1e3,
    "times.theta": -(RISING**2),
    "rate.Time": 3 + RISING / 800, "rate.torque": RISING, "step.Time": 3 + 2 * RISING,
    "table.late": RISING / 1e3, "table.torque": RISING, "table.theta(:,2)": 2 * RISING,
    "runs(2).x": 2 * RISING,
}  # fmt: skip


# of its import
@pytest.mark.filterwarnings("ignore:duration_to_mat", "ignore:The 'future.infer_string' option")
@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_tables_their_clocks_and_the_properties_of_objects_are_read_as_written(version, tmp_path):
    path = written_by_matio(tmp_path / "a.mat", version)
    units = {
        "rate.torque": "N*m",
        "rate.Time": "s",
        "step.Time": "s",
        "table.torque": "N*m",
        "table.theta(:,2)": "deg",
    }
    units |= {"table.late": "s", "z.own.Time": "s", "times.Time": "s", "Test.when": "s"}
    for address, (_, values, unit) in open_mat(path).signals([*OBJECTS]).items():
        np.testing.assert_allclose(
            values, OBJECTS[address], rtol=1e-15, atol=1e-12, err_msg=address
        )
        assert unit == units.get(address, "")
    assert (
        "z is a 1x1 nldat, not numbers; name one of its fields (dataSet, chanNames, own)"
        in refusal(path, "z")
    )
    assert "Test.note is a 1x1 string, not real numbers; save it as numbers, or" in refusal(
        path, "Test.note"
    )
    assert "unlike is a 1x1 table, not real numbers; save its numbers in a struct" in refusal(
        path, "unlike"
    )
    listed = {one.address["variable"]: one.unit for one in inspect_file(path).channels}
    assert {
        "table.theta": "deg",
        "rate.Time": "s",
        "Test.when": "s",
        "z.dataSet": "",
    }.items() <= listed.items()


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("write", [write_mat, write_mat73])
def test_what_is_no_real_number_is_refused_with_the_command_that_saves_it(write, tmp_path):
    path = write(
        tmp_path / "a",
        complex=RISING + 1j,
        results=RISING,
        empty=np.zeros((0, 3)),
        cube=np.ones((2, 3, 4)),
    )
    assert "4 double; save each of its matrices as a variable of its own" in refusal(path, "cube")
    assert "complex double, not real numbers; save `real(x)`" in refusal(path, "complex")
    if write is write_mat73:
        with h5py.File(path, "r+") as file:
            file["text"] = ["/x", "/x"]
            file["results"].attrs["MATLAB_class"] = np.bytes_("timetable")
            file["results"].attrs["MATLAB_object_decode"] = 3
        assert "text is a 2 object, not real numbers" in refusal(path, "text")
        assert "results is a 1x1 timetable, not real numbers; save its numbers" in refusal(
            path, "results"
        )
    else:
        write(path, sparse=scipy.sparse.eye(3), empty=np.zeros((0, 3)))
        assert "save it as `full(x)`" in refusal(path, "sparse")
    assert "empty is empty (0x3 double)" in refusal(path, "empty")


def test_a_cut_behind_the_wanted_variables_and_what_has_no_numbers_beside_them_are_told(tmp_path):
    path = write_mat(tmp_path / "a.mat", x=RISING, y=RISING)
    path.write_bytes(path.read_bytes()[:-9])
    assert at(path, "x").size == RISING.size
    assert open_mat(path).damage.end_missing
    named = write_mat73(tmp_path / "b.mat", x=RISING)
    with h5py.File(named, "a") as file:
        file["kind"], file["nothing"] = np.dtype("f8"), h5py.Empty("f8")
    assert at(named, "x").size == RISING.size
    assert "kind is a 1x1 object, not real numbers" in refusal(named, "kind")
    assert "nothing is empty" in refusal(named, "nothing")
    with h5py.File(named, "a") as file:
        file["outside"], file["circle"] = (
            h5py.ExternalLink("none.mat", "/x"),
            h5py.SoftLink("/circle"),
        )
        file.create_dataset("huge", (1, 10**12), "f8", chunks=(1, 10**6))
    assert "outside is a link to /x and cannot be read (" in refusal(named, "outside")
    assert "circle is a link to /circle and cannot be read (" in refusal(named, "circle")
    assert (
        "huge is a 1000000000000x1 array that was never written, not real numbers; rec"
        in refusal(named, "huge")
    )
    assert not open_mat(named).damage.remarks
    named.write_bytes(named.read_bytes() + bytes(100))
    assert "100 bytes stand behind its end" in open_mat(named).damage.remarks[0]
