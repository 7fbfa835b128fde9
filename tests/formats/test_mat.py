# SPDX-License-Identifier: Apache-2.0
"""MATLAB files of every version: numbers at addresses, tables, objects, and what is refused."""

import sys
import warnings
from datetime import UTC, datetime
from functools import partial

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.sparse
from conftest import refused_with, said_in_refusal
from log_builders import write_mat, write_mat73

from osl_analysis import formats

with warnings.catch_warnings(action="ignore"):  # of the library's import
    from matio import save_to_mat
    from matio.utils.matclass import MatlabOpaque, MatlabOpaqueArray
    from matio.utils.matconvert import convert_py_to_mat


RISING = np.arange(12.0)
CONTENT = {
    "Test": {
        "slow": {"note": "left", "torque": RISING},
        "data": np.column_stack([RISING, RISING**2]),
        "truth": RISING.astype(np.int16),
    },
    "row": RISING[np.newaxis],
}
RUNS = [{"name": "slow", "torque": RISING}, {"name": "fast", "torque": 2 * RISING}]


def trials(write, path):
    cell = np.empty((1, 2), dtype=object)
    cell[0, 0] = RISING
    cell[0, 1] = {"torque": -RISING}
    runs = np.array(
        [[tuple(run.values()) for run in RUNS]], dtype=[(name, object) for name in RUNS[0]]
    )
    return write(path, **CONTENT, runs=runs, cells=cell)


def at(recording, address):
    return recording.find({"variable": address})


refusal = partial(said_in_refusal, at)


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
    "Tset.slow": "'Tset.slow'",
    "Test.slow.torqe": "'Test.slow.torque'",
    "Test.slow": "Test.slow.note, Test.slow.torque",
    "Test.slow.note": "Test.slow.note",
    "Test.data": "Test.data(:,1)",
    "Test.data(:,3)": "12x2",
    "runs.torque": "'runs.torque'",
    "cells": "cells{1}, cells{2}.torque",
    "a b": "'ab'",
}
both_versions = pytest.mark.parametrize("write", [write_mat, write_mat73])


@both_versions
@pytest.mark.parametrize(("address", "expected"), NUMBERS.items())
def test_an_address_in_matlabs_notation_leads_to_the_numbers(write, address, expected, tmp_path):
    recording = formats.read(trials(write, tmp_path / "a.mat"))

    np.testing.assert_array_equal(np.ma.asarray(at(recording, address).read()), expected)


@both_versions
@pytest.mark.parametrize(("address", "message"), NOWHERE.items())
def test_an_address_that_leads_nowhere_says_what_is_there(write, address, message, tmp_path):
    recording = formats.read(trials(write, tmp_path / "a.mat"))

    assert message in refusal(recording, address)


# --- what programs write ------------------------------------------------------------------------


def structs(*elements):
    """An array of structs, (1, elements)."""
    names = [(name, object) for name in elements[0]]
    return np.array([[tuple(element.values()) for element in elements]], dtype=names)


CONTROL_DESK = {
    "rec1": {
        "X": {"Name": "", "Type": "Continuous", "Data": RISING, "Unit": "s"},
        "Y": structs(
            {"Name": "Model Root/IO/angle[deg]/Out1", "Data": -RISING, "Unit": "", "XIndex": 1},
            {"Name": "Model Root/IO/torque/Out1", "Data": RISING**2, "Unit": "Nm", "XIndex": 1},
        ),
    }
}
SIMULINK = {
    "out": {
        "time": RISING,
        "signals": structs(
            {"values": -RISING, "dimensions": 1, "label": "angle[deg]", "blockName": "m/Scope"},
            {"values": RISING**2, "dimensions": 1, "label": "", "blockName": "m/torque"},
        ),
        "blockName": "m/Scope",
    }
}


@both_versions
@pytest.mark.parametrize(
    ("content", "time", "units"),
    [(CONTROL_DESK, "rec1.X.Data", ("s", "Nm")), (SIMULINK, "out.time", ("", ""))],
    ids=["ControlDesk", "Simulink"],
)
def test_signals_in_an_array_of_structs_have_the_names_and_units_beside_them(
    write, content, time, units, tmp_path
):
    recording = formats.read(write(tmp_path / "a.mat", **content))

    clock, angle, torque = (at(recording, name) for name in (time, "angle", "torque"))
    np.testing.assert_array_equal(clock.read(), RISING)
    np.testing.assert_array_equal(angle.read(), -RISING)
    np.testing.assert_array_equal(torque.read(), RISING**2)
    assert (clock.unit, angle.unit, torque.unit) == (units[0], "deg", units[1])
    assert clock.rows.name == angle.rows.name == torque.rows.name


@both_versions
def test_trials_in_an_array_of_structs_keep_the_names_of_their_fields(write, tmp_path):
    """A text beside numbers that are called for what they are is the trial's."""
    listed = formats.read(trials(write, tmp_path / "a.mat")).channels

    names = {channel.key: channel.name for channel in listed}
    assert names["runs(1).torque"] == names["runs(2).torque"] == "torque"


def written_by_matio(path, version):
    """Tables, timetables and other objects, as MATLAB stores them. mat-io writes the times of a
    timetable and no units: a rate, a step, units and what a time has below the ms are put in by
    hand."""
    late = (datetime(2026, 11, 23, 8, tzinfo=UTC).timestamp() * 1e3 + 2 * RISING + 0.25j).reshape(
        -1, 1
    )
    columns = pd.DataFrame(
        {"torque": RISING, "theta": -(RISING**2)}, index=pd.to_timedelta(RISING, unit="ms")
    )
    by_rate, by_step = (convert_py_to_mat(columns, "timetable") for _ in range(2))
    table = convert_py_to_mat(columns.reset_index(names="late"), "table")
    for timetable, is_rate in ((by_rate, True), (by_step, False)):
        inside = timetable.properties["any"][0, 0]
        second = np.array([[np.timedelta64(1, "s")]])
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
        "z": MatlabOpaque(
            {"dataSet": np.column_stack([RISING, -RISING]), "chanNames": "x1", "own": columns},
            "nldat",
        ),
        "Test": {"when": MatlabOpaque({"data": late}, "datetime"), "plain": RISING, "note": note},
        "times": columns,
        "rate": by_rate,
        "step": by_step,
        "table": table,
        "runs": MatlabOpaqueArray(several, "run"),
        "unlike": MatlabOpaque({"data": 1.0}, "table"),
    }
    save_to_mat(path, content, version=version)
    if version == "v7.3":  # a struct without fields, as MATLAB writes it
        with h5py.File(path, "a") as file:
            del file["Test"].attrs["MATLAB_fields"]
            file["Test"]["bare"] = np.ones(2, np.uint64)
            file["Test"]["bare"].attrs.update(MATLAB_class=np.bytes_("struct"), MATLAB_empty=1)
    return path


OBJECTS = {
    "z.dataSet(:,2)": -RISING,
    "z.own.Time": RISING / 1e3,
    "z.own.torque": RISING,
    "Test.plain": RISING,
    "Test.when": 1795420800.00025 + RISING * 2e-3,
    "times.Time": RISING / 1e3,
    "times.theta": -(RISING**2),
    "rate.Time": 3 + RISING / 800,
    "rate.torque": RISING,
    "step.Time": 3 + 2 * RISING,
    "table.late": RISING / 1e3,
    "table.torque": RISING,
    "table.theta_2": 2 * RISING,
    "runs{2}.x": 2 * RISING,
}
UNITS = {
    "rate.torque": "N*m",
    "rate.Time": "s",
    "step.Time": "s",
    "rate.theta": "deg",
    "table.late": "s",
    "z.own.Time": "s",
    "times.Time": "s",
    "Test.when": "s",
}


@pytest.mark.filterwarnings("ignore:duration_to_mat")
@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_tables_clocks_and_properties_of_objects_are_read_as_written(version, tmp_path):
    recording = formats.read(written_by_matio(tmp_path / "a.mat", version))

    for address, expected in OBJECTS.items():
        channel = at(recording, address)
        np.testing.assert_allclose(
            channel.values, expected, rtol=1e-15, atol=1e-12, err_msg=address
        )
        assert channel.unit == UNITS.get(address, ""), address
    assert "Test.note" in refusal(recording, "Test.note")


# --- what is no signal, and damage --------------------------------------------------------------


@both_versions
def test_what_is_no_row_of_real_numbers_is_refused_and_a_cut_file_too(write, tmp_path):
    odd = {"complex": RISING + 1j, "cube": np.ones((2, 3, 4)), "empty": np.zeros((0, 3))}
    if write is write_mat:
        odd["sparse"] = scipy.sparse.eye(3)
    path = write(tmp_path / "a.mat", **odd, y=np.random.default_rng(1).random(500))
    recording = formats.read(path)
    remedies = {"complex": "`real(x)`", "sparse": "`full(x)`"}

    for name in odd:
        assert remedies.get(name, "(:,1)") in refusal(recording, name)
    path.write_bytes(path.read_bytes()[:-900])
    with refused_with(r"a\.mat:.*;.*file"):
        formats.read(path)


def test_without_the_library_it_is_named(tmp_path, monkeypatch):
    path = write_mat(tmp_path / "a.mat", x=RISING)
    monkeypatch.setitem(sys.modules, "matio", None)

    with refused_with("-m pip install mat-io$"):
        formats.read(path)
