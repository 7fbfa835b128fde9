"""Files of every format, damaged at random: whatever is read was written, or a loss is told,
exactly or as not known.

`benchmarks/damaged_files.py` has the files, reads thousands, and prints what became of them; here a
hundred."""

import sys
from contextlib import suppress
from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pytest
from c3d_builder import write_c3d
from conftest import ROOT
from mcap_builder import stamped, write_log
from test_formats_mat import write_mat73

from osl_analysis.errors import InputError
from osl_analysis.old_formats.c3d import BLOCK
from osl_analysis.ingest.raw_files import FORMATS, recognise, tell_odd_steps
from osl_analysis.ingest.source import (
    Recording,
    bends_of,
    check_sizes,
    leaps_of,
    values_of_no_sensor,
)

sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script there
from damaged_files import COLUMN, KINDS, MESSAGES, ROWS, Kind, by, cases, exchanged, moved, signals

sys.path.pop(0)
TEXT = (".csv", ".tsv", ".jsonl", ".mot", ".trc")
OF_C3D = FORMATS["c3d"].source.model_validate({"format": "c3d"})
OF_CSV = FORMATS["csv"].source.model_validate({"format": "csv", **COLUMN})


def test_whatever_is_read_of_a_damaged_file_was_written_or_its_loss_is_told(tmp_path: Path) -> None:
    found = [became for *_, became in cases(4 * len(KINDS), 7, tmp_path)]
    assert not [
        became for became in found if became.partition(":")[0] in ("WRONG", "silent", "wrong count")
    ]
    assert min(found.count(one) for one in ("refused", "told", "harmless", "limit")) > 3


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_half_a_file_is_refused_or_its_end_is_missing_or_not_known(
    kind: Kind, tmp_path: Path
) -> None:
    """Cut where a row or a segment ends: text and TDMS do not say how long they are."""
    one = kind.write(tmp_path / kind.file, 0)
    known = FORMATS[recognise(one)]
    source = known.source.model_validate({"format": recognise(one), **kind.source})
    part = max(
        (own for own in [*one.rglob("*"), one] if own.is_file()), key=lambda own: own.stat().st_size
    )
    content = part.read_bytes()
    mark = b"TDSm" if one.suffix == ".tdms" else b"\n" if one.suffix in TEXT else b""
    at = content.find(mark, len(content) // 2) + (mark == b"\n")
    part.write_bytes(content[: at if at > 0 else len(content) // 2])
    with suppress(InputError):
        recording = known.read(one, source)
        damage = recording.damage.report(recording.topics)
        assert damage["complete"] is not True
        assert damage["expected"] is None or damage["lost"]
        assert mark == b"\n" or damage["end_missing"] or "end" in known.inspect(one).facts


def test_a_number_of_samples_above_a_table_tells_that_its_end_is_missing(tmp_path: Path) -> None:
    rows = "".join(f"{k / 100},{k % 7},{k % 5}\n" for k in range(60))
    for above, complete, end_missing in (
        ("Samples: 60\n", True, False), ("# Number of frames: 120\n", False, True),
        ("Subject: 120\n", None, False),
        ("Samples,60,60\n", True, False), ("Total samples=600\n", False, True),
        ("Samples: 1.5 s\n", None, False),
    ):  # fmt: skip
        (tmp_path / "a.csv").write_text(above + "t,a,f\n" + rows)
        report = FORMATS["csv"].read(tmp_path / "a.csv", OF_CSV).damage.report()
        told = report["complete"], report["end_missing"], report["lost"]
        assert told == (complete, end_missing, 0 if complete else None)


def test_numbers_of_any_size_are_refused_and_numpy_warns_of_none(tmp_path: Path) -> None:
    for name in "taf":
        (written := signals(0))[name][300:302] = -1.7e308, 1.7e308
        pl.DataFrame(written).write_csv(path := tmp_path / "a.csv")
        FORMATS["csv"].inspect(path)
        with pytest.raises(InputError):
            check_sizes(FORMATS["csv"].read(path, OF_CSV))


def test_two_parts_of_an_array_at_one_place_are_refused(tmp_path: Path) -> None:
    """A flipped bit in the index gave a part twice and another not at all."""
    write_mat73(path := tmp_path / "a.mat", **signals(0))
    with h5py.File(path, "a") as file:
        del file["f"]
        torque = file.create_dataset("f", (1, ROWS), "f8", chunks=(1, 40))
        torque[0] = signals(0)["f"]
        # in the file's own
        first, second = (torque.id.get_chunk_info(number).byte_offset - 512 for number in (0, 1))
    path.write_bytes(
        path.read_bytes().replace(second.to_bytes(8, "little"), first.to_bytes(8, "little"))
    )
    source = FORMATS["mat"].source.model_validate({"format": "mat", **by("variable")})
    with pytest.raises(InputError, match="stand at one place: the index is damaged"):
        FORMATS["mat"].read(path, source)


def test_a_part_that_is_that_of_another_place_is_lost_and_motion_without_noise_is_not(
    tmp_path: Path,
) -> None:
    """Of a C3D file a block of 512 bytes, of a table 40 rows or those of one channel, between a
    sensor's noise. Sound are periods of a motion without noise or a part of it that comes again,
    slow turns, what a coarse encoder has often, also beside noise, and a torque without noise that
    rests."""
    every, clock = np.random.default_rng(3).normal(size=(6000, 5)), np.arange(6000) / 100
    noise = every[:600]
    # else no marker is seen
    write_c3d(path := tmp_path / "a.c3d", np.abs(noise[:, None, :4]), noise[:, 4:])
    content = path.read_bytes()
    assert not FORMATS["c3d"].read(path, OF_C3D).losses
    start = len(content) // BLOCK * BLOCK - 9 * BLOCK
    path.write_bytes(
        content[:start] + content[start - 10 * BLOCK :][:BLOCK] + content[start + BLOCK :]
    )
    told = FORMATS["c3d"].read(path, OF_C3D)
    assert "written over another" in told.warnings[0]
    assert told.losses["lost"] is None
    analogs = {"theta": {"channel": "A1", "unit": "rad"}}
    source = FORMATS["c3d"].source.model_validate({"format": "c3d", "analogs": analogs})
    write_c3d(
        path,
        noise[:, None, :4],
        np.r_[noise[:100, 4:] + 30, np.zeros((40, 1)), noise[140:, 4:] + 30],
    )
    zeroed = FORMATS["c3d"].read(path, source)
    assert (zeroed.losses["lost"], "values that no sensor gives" in zeroed.warnings[0]) == (
        None,
        True,
    )
    # of 600 messages, as the log says, all are there
    torque = [*noise[:300, 1] + 30, *[0.0] * 4, *noise[304:, 1] + 30]
    pairs = enumerate(zip(noise[:, 0], torque, strict=True))
    rows = [stamped(k * 10**7, angle=a, torque=f, sync=False) for k, (a, f) in pairs]
    source = FORMATS["mcap"].source.model_validate({"format": "mcap", **MESSAGES})
    assert FORMATS["mcap"].read(write_log(tmp_path / "a.mcap", rows), source).losses["lost"] is None
    angle, torque = noise[:, 0], np.round(noise[:, 1], 1)
    copied = [np.r_[one[:300], one[100:140], one[340:]] for one in (angle, torque)]
    period, ramp = (
        np.tile(noise[:300, 2], 2),
        np.r_[angle[:60], np.linspace(0, 1, 60).round(3), angle[120:]],
    )
    ramp[300:360] = ramp[60:120]
    turns = np.multiply.outer(clock, 2 * np.pi * np.array([0.5, 1.5, 2.5, 3.5, 5.5]))
    coarse = (
        np.round((np.sin(turns + np.arange(5) ** 2).sum(axis=1) + every[:, 2] / 2000) * 200) / 200
    )
    sine = np.round(np.sin(clock[:600] * 2 * np.pi), 6)
    command = np.sin(turns[:600, 0]) + np.sin(turns[:600, 1] * 2**0.5)
    command[400:500] = command[50:150]
    rests = np.where(clock[:600] % 4 < 2, 0, sine + 0.3)
    for a, f, lost in (
        (command, torque, 0), (angle, rests, 0), (angle, torque, 0), (sine, sine, 0),
        (period, period, 0),
        (ramp, torque, 0), (coarse, every[:, 1], 0),
        (np.r_[every[:3100, 3], coarse[3100:]], every[:, 1], 0),
        (copied[0], torque, None), (copied[0], copied[1], None),
        (np.r_[angle[:300], angle[100:110], angle[310:]], torque, None),
        # behind a part that stands twice
        (np.r_[angle[:200], angle[:400]], np.r_[torque[:200], torque[:400]], None),
        # from the end of one into the next
        (angle, np.r_[torque[:300], angle[590:], torque[:30], torque[340:]], None),
        # of a coarse converter values repeat, many in a row seldom
        (np.round(2 * copied[0]), torque, None),
        (np.round(copied[0] / 2), torque, 0),  # whose noise is too small to tell
        (np.repeat(np.round(angle[:150]), 4), torque, 0),  # held
    ):  # fmt: skip
        pl.DataFrame({"t": clock[: a.size], "a": a, "f": f}).write_csv(tmp_path / "a.csv")
        assert FORMATS["csv"].read(tmp_path / "a.csv", OF_CSV).damage.lost() == lost


def test_a_block_of_one_channel_over_another_is_lost_and_a_channel_that_follows_is_not(
    tmp_path: Path,
) -> None:
    """Sound are a command, an angle that is the same later, and the levels of a drive."""
    k, noise = np.arange(600), np.random.default_rng(3).normal(size=(600, 2))
    t, steps = k / 100, np.repeat([0.0, 5.0, -5.0, 2.0, 0.0, 1.0], 100) + 1e-3 * k
    angle, torque = (
        20 * np.sin(k / 27) + 0.05 * noise[:, 0],
        30 * np.cos(k / 25) + 0.1 * noise[:, 1],
    )
    levels = np.repeat([0.0, 5.0, 0.0, 5.0, 0.0], 120) + 0.05 * noise[:, 0]
    over, ramp = (np.r_[torque[:300], x[100:106], torque[306:]] for x in (angle, t))
    few, beside = (
        np.r_[angle[:300], angle[100:104], angle[304:]],
        np.r_[torque[:300], torque[100:130], torque[330:]],
    )
    for a, f, told in (
        (angle, torque, ""), (angle, levels, ""),
        (angle, over, "6 samples of torque from 3.000 s on are those of th"),
        (angle, ramp, "6 samples of torque are values that no sensor gives"),
        (few, torque, "4 samples of theta from 3.000 s on are"),
        (angle, beside, "30 samples of torque from 3.000"),
        (angle, np.r_[torque[:1], 0.0, torque[2:]],
         "1 samples of torque are values that no sensor gives"),
        (steps, np.r_[steps[:1], steps[:-1]], ""),
    ):  # fmt: skip
        pl.DataFrame({"t": t, "a": a, "f": f}).write_csv(tmp_path / "a.csv")
        recording = FORMATS["csv"].read(tmp_path / "a.csv", OF_CSV)
        assert (not recording.warnings, any(told in said for said in recording.warnings)) == (
            not told,
            bool(told),
        )
        assert not told or any(one["no_sensor"] for one in recording.columns.values())


def test_one_wrong_number_is_told_by_what_all_others_leave_and_corners_and_impacts_are_not() -> (
    None
):
    k, noise = np.arange(2000), np.random.default_rng(3).normal(size=2000)
    motion = 30 * np.sin(k / 25) + 0.1 * noise
    for row, size, told in (
        (700, 4.0, True),
        (700, 2.5, True),
        (700, 1.0, False),
        (3, 4.0, True),
        (1, 4.0, True),
    ):
        wrong = motion.copy()
        wrong[row] += size  # 40 SD of the noise, which the motion itself does in three rows
        found = values_of_no_sensor("torque", k / 100, wrong, {})
        assert found is not None
        assert np.flatnonzero(found).tolist() == [row] * told
    for sound in (
        np.maximum(k - 700.0, 0),
        np.exp(-np.abs(k - 700.3) / 2),
        np.where(k > 700, 5.0, 0) + 0.1 * noise,
    ):
        assert all(a == b for a, b in leaps_of(sound, bends_of(sound), 0.0))


def test_a_torque_off_its_curve_where_the_angle_is_too_is_no_damage() -> None:
    """A step of 3 degrees in 16 ms at 250 Hz; and 20 samples of another channel, into which an
    angle leaps a little."""
    k, noise, size = (
        np.arange(2000),
        np.random.default_rng(3).normal(size=(2, 2000)),
        np.zeros(2000),
    )
    size[701:] = np.clip(np.arange(1299) / 4 + 0.25, 0, 1)
    still = 0.02 * np.sin(k / 25) + 1e-5 * noise[0]
    torque = 187 * (still + 0.05 * size) + 0.05 * noise[1] + 24 * (k == 702)  # by speed
    for theta, told in ((still + 0.05 * size, False), (still, True)):
        assert np.any(values_of_no_sensor("torque", k / 250, torque, {}, theta)) == told
    rough = np.where((k >= 500) & (k < 520), 0.007 + 1e-3 * noise[1], still)
    found = values_of_no_sensor("theta", k / 250, rough, {})
    assert found is not None
    assert np.flatnonzero(found).tolist() == [*range(500, 520)]


def test_zeros_into_which_a_channel_leaps_where_it_crosses_zero_are_told() -> None:
    k, noise = np.arange(2000), np.random.default_rng(3).normal(size=2000)
    torque = 30 * np.sin(k / 25) + 0.1 * noise
    # by 2 N*m; noise; before it moves
    for first, stop, told in ((703, 707, True), (705, 707, False), (0, 628, False)):
        found = values_of_no_sensor(
            "torque", k / 100, np.where((k >= first) & (k < stop), 0.0, torque), {}
        )
        assert (found is not None, np.any(found)) == (True, told)


def test_an_angle_that_moves_faster_than_a_joint_can_is_no_sensors(tmp_path: Path) -> None:
    """At 100 Hz, where a torque may leap: half a radian in one row."""
    k, noise = np.arange(2000), np.random.default_rng(3).normal(size=2000)
    angle = 0.35 * np.sin(k / 27) + 1e-3 * noise
    moved = np.r_[angle[:700], angle[100:130], angle[730:]]
    # in 4 ms
    back = [np.interp(k, [640, 707, 708, 709], [0, size, size, 0], 0, 0) for size in (0.02, 0.012)]
    quiet = 0.05 * np.sin(k / 27) + 1e-5 * noise
    for column, rate, x, expected in (
        ("theta", 100, moved, [*range(700, 730)]), ("torque", 100, moved, []),
        ("theta", 250, quiet + back[0], [709]), ("theta", 250, quiet + back[1], []),
    ):  # fmt: skip
        found = values_of_no_sensor(column, k / rate, x, {})
        assert found is not None
        assert np.flatnonzero(found).tolist() == expected


def test_two_blocks_that_changed_places_are_told_and_a_pulse_a_decay_and_what_waits_are_not(
    tmp_path: Path,
) -> None:
    """Side by side or apart, where two leaps stand out or four, also of a channel that often
    repeats a value."""
    k, noise = np.arange(2000), np.random.default_rng(3).normal(size=2000)
    torque = 20 * np.sin(k / 40) + 10 * np.sin(k / 17) + 0.1 * noise
    decay, pulse = 30 * np.exp(-k / 20) * np.cos(k / 30), 20.0 * ((k >= 500) & (k < 700))
    for first, second, size in ((500, 900, 100), (500, 600, 100), (1300, 1900, 60), (0, 0, 0)):
        one, two = np.r_[first : first + size], np.r_[second : second + size]
        swapped = torque.copy()
        swapped[one], swapped[two] = torque[two], torque[one]
        for column, size_of in (("torque", 1.0), ("theta", 1e-3)):
            found = values_of_no_sensor(column, k / 1000, size_of * swapped, {})
            assert found is not None
            assert np.flatnonzero(found).tolist() == [*one, *two]
    assert {
        exchanged("multisine", channel, k) for channel in ("theta", "torque") for k in (0, 1, 3, 4)
    } == {"told"}
    assert {exchanged("noise", "torque", k) for k in (5, 10, 11, 321, 331, 370)} == {"told"}
    assert [exchanged("steps", "theta", k) for k in range(20)].count("told") > 18
    for sound in (torque + pulse, decay, moved("steps", np.random.default_rng(1))["theta"]):
        assert not np.any(values_of_no_sensor("torque", k / 1000, sound, {}))
    for waits in (300, 3):  # rows in which nothing was recorded; then in one channel alone
        a, f = (np.where(k < waits, 0.0, one + 20) for one in (torque, torque[::-1]))
        for angle, told in ((a, False), (torque, waits > 6)):
            pl.DataFrame({"t": k / 1000, "a": angle, "f": f}).write_csv(tmp_path / "a.csv")
            recording, held = (
                FORMATS["csv"].read(tmp_path / "a.csv", OF_CSV),
                angle is a and waits > 6,
            )
            assert recording.damage.is_doubted == told
            assert (
                any("all channels hold one value up to 0.3" in said for said in recording.warnings)
                == held
            )


def test_markers_that_all_leap_in_one_frame_are_told_and_one_marker_that_does_is_not(
    tmp_path: Path,
) -> None:
    """Two blocks of frames changed places: each number stands once, and no frame of C3D has a
    number."""
    k, scatter = (
        np.arange(400)[:, None, None],
        np.random.default_rng(3).normal(0, 0.05, (400, 3, 4)),
    )
    walked = 300 * np.sin(k / 30 + np.arange(12).reshape(3, 4) / 10) + scatter
    walked[:, :, 3] = 0.0
    swapped, one, hidden, flipped = (walked.copy() for _ in range(4))
    flipped[200, 1, 2] += 100
    swapped[100:120], swapped[250:270] = walked[250:270], walked[100:120]
    one[100:, 0, :3] += 500
    hidden[:250, 2] = hidden[100:120] = 0.0
    for points, told in ((walked, 0), (swapped, 4), (one, 0), (hidden, 0)):
        write_c3d(tmp_path / "a.c3d", points)
        said = [
            text
            for text in FORMATS["c3d"].read(tmp_path / "a.c3d", OF_C3D).warnings
            if "all markers leap" in text
        ]
        assert [text.partition(": ")[2][:7] for text in said] == [f"{told} times"] * bool(told)
    write_c3d(tmp_path / "a.c3d", flipped)
    recording = FORMATS["c3d"].read(tmp_path / "a.c3d", OF_C3D)
    assert [
        "marker_M2_z leaves its curve and comes back 1 times" in text for text in recording.warnings
    ] == [True]
    assert recording.losses["lost"] is None


def test_a_step_of_time_unlike_all_others_is_told_and_one_of_an_uneven_clock_is_not(
    tmp_path: Path,
) -> None:
    k, noise = np.arange(600), np.random.default_rng(3).normal(size=600)
    uneven = k / 100 + 2e-4 * noise
    told = {}
    for name, t in (
        ("even", k / 100),
        ("lost", np.r_[k[:300], k[304:]] / 100),
        ("uneven", np.delete(uneven, 300)),
    ):
        pl.DataFrame({"t": t, "a": noise[: t.size], "f": noise[::-1][: t.size]}).write_csv(
            path := tmp_path / "a.csv"
        )
        recording = FORMATS["csv"].read(path, OF_CSV)
        told[name] = len(recording.warnings), recording.damage.is_doubted
    assert told == {"even": (0, False), "lost": (1, True), "uneven": (0, False)}
    torque = pl.Series("torque", noise).set(pl.Series((k >= 300) & (k < 304)), None)
    tell_odd_steps(
        alone := Recording(pl.DataFrame({"time": k / 100, "theta": noise, "torque": torque}), {})
    )
    assert [said[:40] for said in alone.damage.remarks] == [
        "time of torque goes on by 0.05 s at 2.99"
    ]


def test_chunks_that_were_never_written_are_lost_and_not_zeros(tmp_path: Path) -> None:
    written, source = signals(0), {"format": "mat", **by("variable")}
    for name, time, first in (
        ("end.mat", {}, 0),
        ("middle.mat", {}, 30),
        ("rate.mat", {"time": {"rate": 100}}, 30),
    ):
        write_mat73(tmp_path / name, **signals(0))
        with h5py.File(tmp_path / name, "a") as file:
            del file["f"]
            kept = np.r_[:first, first + 20 : ROWS] if first else np.arange(ROWS - 20)
            torque = file.create_dataset("f", (1, ROWS), "f8", chunks=(1, 10))
            torque[0, kept] = written["f"][kept]
        described = FORMATS["mat"].source.model_validate(source | time)
        if time:
            with pytest.raises(
                InputError,
                match=rf"20 of {ROWS} samples of f were never written .*, or name its time",
            ):
                FORMATS["mat"].read(tmp_path / name, source=described)
            continue
        recording = FORMATS["mat"].read(tmp_path / name, source=described)
        np.testing.assert_array_equal(recording.samples["torque"], written["f"][kept])
        assert [recording.losses[key] for key in ("expected", "read", "lost")] == [
            ROWS,
            ROWS - 20,
            20,
        ]
        assert any(
            f"20 of {ROWS} samples of f were never written" in text for text in recording.warnings
        )
