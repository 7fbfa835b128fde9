"""MATLAB files of every version: numbers at addresses, tables, objects, and what is refused."""

import sys
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
import scipy.sparse

from osl_analysis import formats
from osl_analysis.errors import InputError
from osl_analysis.formats.mat import MatSource
from osl_analysis.recording import Channel, Recording

HEADER73 = b"MATLAB 7.3 MAT-file, made for a test".ljust(124) + b"\x00\x02IM"


def write_mat(path: Path, **variables: object) -> Path:
    """A file of version 5."""
    scipy.io.savemat(path, variables, do_compression=True)
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
    if isinstance(value, str):
        item.attrs["MATLAB_int_decode"] = 2
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
    cell[0, 0] = RISING
    cell[0, 1] = {"torque": -RISING}
    runs = np.array(
        [[tuple(run.values()) for run in RUNS]], dtype=[(name, object) for name in RUNS[0]]
    )
    return write_mat(path, **CONTENT, runs=runs, cells=cell)


def written73(path: Path) -> Path:
    return write_mat73(path, **CONTENT, runs=RUNS, cells=(RISING, {"torque": -RISING}))


def source(part: str) -> MatSource:
    """A source file for one part."""
    return MatSource.model_validate(
        {
            "format": "mat",
            "log_part": part,
            "time": {"rate": 100},
            "channels": {"signal_x": {"variable": "x", "unit": "1"}},
        }
    )


def at(recording: Recording, address: str) -> Channel:
    return recording.find({"variable": address})


def numbers_at(recording: Recording, address: str) -> np.ndarray:
    return np.ma.asarray(at(recording, address).read())


def refusal(recording: Recording, address: str) -> str:
    with pytest.raises(InputError, match=r"^[^\n]+$") as caught:
        at(recording, address)
    return str(caught.value)


NUMBERS = {
    "Test.slow.torque": RISING,
    "Test.data(:,2)": RISING**2,
    "Test.truth": RISING,
    "row": RISING,
    "runs( 2 ).torque": 2 * RISING,
    "cells{1}": RISING,
    "cells{2}.torque": -RISING,
}
NOWHERE = {
    "Tset.slow": "nothing stands at 'Tset.slow'; the file has",
    "Test.slow.torqe": "did you mean 'Test.slow.torque'?",
    "Test.slow": "nothing stands at 'Test.slow'; the file has Test.slow.note, Test.slow.torque",
    "Test.slow.note": "Test.slow.note is text, which is not read; save it as real numbers",
    "Test.data": "is 12x2 float64; choose one column, as Test.data(:,1)",
    "Test.data(:,3)": "Test.data is 12x2 float64; choose one column",
    "runs.torque": "nothing stands at 'runs.torque'; the file has",
    "cells": "nothing stands at 'cells'; the file has cells{1}, cells{2}.torque",
    "a b": "nothing stands at 'ab'",
}
both_versions = pytest.mark.parametrize("write", [written5, written73])


@both_versions
@pytest.mark.parametrize(("address", "expected"), NUMBERS.items())
def test_an_address_in_matlabs_notation_leads_to_the_numbers(
    write: Callable[[Path], Path], address: str, expected: Any, tmp_path: Path
) -> None:
    recording = formats.read(write(tmp_path / "a.mat"))

    np.testing.assert_array_equal(numbers_at(recording, address), expected)


@both_versions
@pytest.mark.parametrize(("address", "said"), NOWHERE.items())
def test_an_address_that_leads_nowhere_says_what_is_there(
    write: Callable[[Path], Path], address: str, said: str, tmp_path: Path
) -> None:
    recording = formats.read(write(tmp_path / "a.mat"))

    assert said in refusal(recording, address)


def test_elements_are_counted_column_by_column_as_in_matlab(tmp_path: Path) -> None:
    cell = np.empty((2, 2), dtype=object)
    array = np.zeros((2, 2), dtype=[("x", object)])
    for row, column in np.ndindex(2, 2):
        cell[row, column] = array["x"][row, column] = np.array([row, column, 0.5] * 4)
    every = [[0, 0, 0.5] * 4, [1, 0, 0.5] * 4, [0, 1, 0.5] * 4, [1, 1, 0.5] * 4]
    arrays = [np.array(one) for one in every]
    as5 = write_mat(tmp_path / "a.mat", cells=cell, structs=array)
    as73 = write_mat73(tmp_path / "b.mat", cells=(*arrays,), structs=[{"x": one} for one in arrays])

    for path in (as5, as73):
        recording = formats.read(path)
        for address in ("cells{%d}", "structs(%d).x"):
            for number, expected in enumerate(every, start=1):
                assert numbers_at(recording, address % number).tolist() == expected


def test_variables_of_one_length_in_one_struct_share_rows(tmp_path: Path) -> None:
    test = {"time": np.arange(20.0), "torque": np.arange(20.0), "emg": np.arange(200.0)}
    recording = formats.read(write_mat(tmp_path / "a.mat", Test=test, other=np.arange(20.0)))

    time, torque, emg, other = (
        at(recording, name).rows for name in ("Test.time", "Test.torque", "Test.emg", "other")
    )

    assert time is torque
    assert (time.name, time.count, emg.count, other.name) == ("Test", 20, 200, "")


def test_single_numbers_are_notes_and_no_signals(tmp_path: Path) -> None:
    recording = formats.read(write_mat(tmp_path / "a.mat", Fs=500.0, torque=np.arange(20.0)))

    assert recording.notes == ["Fs=500.0"]
    assert [one.key for one in recording.channels] == ["torque"]


def test_the_address_of_a_part_is_left_out_within_it_and_others_begin_with_a_slash(
    tmp_path: Path,
) -> None:
    slow = {"x": RISING, "m": np.column_stack([RISING, -RISING])}
    path = write_mat(tmp_path / "a.mat", slow=slow, fast={"x": 2 * RISING}, rig={"load": RISING})

    recording = formats.read(path, source("slow"))

    assert [one.key for one in recording.channels] == ["x", "m(:,1)", "m(:,2)"]
    np.testing.assert_array_equal(numbers_at(recording, "x"), RISING)
    np.testing.assert_array_equal(numbers_at(recording, "m(:,2)"), -RISING)
    np.testing.assert_array_equal(numbers_at(recording, "/fast.x"), 2 * RISING)
    np.testing.assert_array_equal(numbers_at(recording, "/rig.load"), RISING)
    assert "nothing stands at 'slow.load'; the file has slow.x" in refusal(recording, "load")


# --- what programs write ------------------------------------------------------------------------

TIME = np.arange(40) / 500


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
    "table.late": RISING / 1e3, "table.torque": RISING, "table.theta_2": 2 * RISING,
    "runs(2).x": 2 * RISING,
}  # fmt: skip
UNITS = {
    "rate.torque": "N*m", "rate.Time": "s", "step.Time": "s", "rate.theta": "deg",
    "table.late": "s", "z.own.Time": "s", "times.Time": "s",
    "Test.when": "s",
}  # fmt: skip


# of its import
@pytest.mark.filterwarnings("ignore:duration_to_mat", "ignore:The 'future.infer_string' option")
@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_tables_their_clocks_and_the_properties_of_objects_are_read_as_written(
    version: str, tmp_path: Path
) -> None:
    recording = formats.read(written_by_matio(tmp_path / "a.mat", version))

    for address, expected in OBJECTS.items():
        channel = at(recording, address)
        np.testing.assert_allclose(
            channel.values, expected, rtol=1e-15, atol=1e-12, err_msg=address
        )
        assert channel.unit == UNITS.get(address, ""), address
    assert "Test.note is text, which is not read" in refusal(recording, "Test.note")


# --- what is no signal, and damage --------------------------------------------------------------


@pytest.mark.parametrize("write", [write_mat, write_mat73])
def test_what_is_no_row_of_real_numbers_is_refused_and_a_cut_file_too(
    write: Callable[..., Path], tmp_path: Path
) -> None:
    odd = {"complex": RISING + 1j, "cube": np.ones((2, 3, 4)), "empty": np.zeros((0, 3))}
    if write is write_mat:
        odd["sparse"] = scipy.sparse.eye(3)
    path = write(tmp_path / "a.mat", **odd, y=np.random.default_rng(1).random(500))
    recording = formats.read(path)
    remedies = {"complex": "`real(x)`", "sparse": "`full(x)`"}

    for name in odd:
        assert remedies.get(name, "choose one column") in refusal(recording, name)
    path.write_bytes(path.read_bytes()[:-900])
    with pytest.raises(InputError, match=r"a\.mat: cannot be read .*; copy the file again"):
        formats.read(path)


def test_without_the_library_the_extra_that_brings_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_mat(tmp_path / "a.mat", x=RISING)
    monkeypatch.setitem(sys.modules, "matio", None)

    with pytest.raises(InputError, match=r"pip install 'osl-analysis\[matlab\]'"):
        formats.read(path)
