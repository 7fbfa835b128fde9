"""JSON messages: what is parsed at once equals what Python's own parser reads, and what is absent is null."""

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from osl_analysis.formats.mcap.mcap_file import read_mcap
from osl_analysis.formats.mcap.topics import Decoded, decode_topics
from osl_analysis.ingest.mcap_log import McapSource, read_mcap_log

REAL_DATA = Path(__file__).parents[2] / "shared" / "real_data"
MILLISECOND = 1_000_000


def write(path: Path, texts: list[str], chunk_size: int = 1 << 20) -> Path:
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size)
        writer.start()
        channel = writer.register_channel("/lab", "json", 0)
        for i, text in enumerate(texts):
            writer.add_message(channel, i * MILLISECOND, text.encode(), i * MILLISECOND, i)
        writer.finish()
    return path


def read(path: Path, *fields: str) -> Decoded:
    return decode_topics(read_mcap(path), {"/lab": fields}, fields)["/lab"]


number = st.one_of(
    st.floats(allow_nan=False), st.integers(-(2**70), 2**70), st.integers(-9, 9), st.booleans(), st.none()
)
regular = st.fixed_dictionaries(
    {"a": st.floats(allow_nan=False), "b": st.fixed_dictionaries({"c": st.integers(-9, 9)})}
)
odd = st.fixed_dictionaries(
    {},
    optional={
        "a": st.one_of(number, st.text("ab", max_size=2)),
        "b": st.one_of(st.none(), st.fixed_dictionaries({}, optional={"c": number, "a": number})),
        "d": st.lists(st.floats(allow_nan=False), max_size=3),
    },
)


def at(message: Any, path: str) -> Any:
    """The value at one of the test's own paths."""
    if path == "d[1]":
        return message["d"][1] if len(message.get("d", ())) > 1 else None
    for name in path.split("."):
        message = message.get(name) if isinstance(message, dict) else None
    return None if isinstance(message, str) else message


@settings(max_examples=150, deadline=None)
@given(st.lists(regular, max_size=4), st.lists(odd, max_size=4), st.sampled_from([None, 1]), st.booleans())
def test_messages_of_any_shape_equal_pythons_parser(first: Any, then: Any, indent: Any, arrays: bool) -> None:
    texts = [json.dumps(one, indent=indent) for one in [*first, *first, *then]] or ["{}"]
    paths = ["a", "b.c", "d[1]"] if arrays else ["a", "b.c"]
    with tempfile.TemporaryDirectory() as folder:
        decoded = read(write(Path(folder) / "log.mcap", texts, chunk_size=200), *paths)
    for path in paths:
        expected = [at(json.loads(text), path) for text in texts]
        assert decoded.present[path].tolist() == [value is not None for value in expected]
        for found, value in zip(decoded.values[path], expected, strict=True):
            if value is not None:
                assert found == (value if -(2**53) < value < 2**53 else pytest.approx(value, rel=2**-52))


def test_a_real_json_log_equals_pythons_parser() -> None:
    path = REAL_DATA / "mcap" / "rerun_json_and_protobuf.mcap"
    if not path.exists():
        pytest.skip("real data are not here")
    with path.open("rb") as file:
        messages = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages(topics=["mouse"])]
    decoded = decode_topics(read_mcap(path), {"mouse": ["clientX", "clientY"]})["mouse"]
    for name in ("clientX", "clientY"):
        assert decoded.values[name].tolist() == [message[name] for message in messages]
    assert decoded.how[0]["one_by_one"] == 0


def test_a_number_with_a_fraction_after_whole_ones_is_not_cut(tmp_path: Path) -> None:
    path = write(tmp_path / "log.mcap", ['{"a": 1}'] * 30 + ['{"a": 2.5}'], chunk_size=400)
    assert read(path, "a").values["a"].tolist() == [1.0] * 30 + [2.5]


def test_an_integer_beyond_a_floats_reach_is_exact_in_every_chunk(tmp_path: Path) -> None:
    texts = [json.dumps({"a": 2**53 + 1 + 2 * i if i > 20 else i}) for i in range(60)]
    decoded = read(write(tmp_path / "log.mcap", texts, chunk_size=400), "a")
    assert decoded.values["a"].tolist() == [json.loads(text)["a"] for text in texts]


@pytest.mark.parametrize("twice", ['"a": 1, "b": 0, "a": 2', '"a" : 1, "a": 2', '"a": 1, "\\u0061": 2'])
@pytest.mark.parametrize("place", [0, 5, 39])
def test_a_message_that_writes_a_field_twice_is_lost_and_said(tmp_path: Path, twice: str, place: int) -> None:
    texts = ['{"a": 3, "c": {"b": 1}, "d": {"b": 2}}'] * 39
    texts.insert(place, f'{{{twice}, "c": {{"b": 1}}, "d": {{"b": 2}}}}')
    path = write(tmp_path / "log.mcap", texts, chunk_size=400)
    file = read_mcap(path)
    decoded = decode_topics(file, {"/lab": ["a", "c.b"]})["/lab"]
    assert decoded.values["a"].tolist() == [3] * 39
    assert any(
        "1 of 40 messages of topic '/lab' are lost: field 'a' is written twice" in r for r in file.damage.remarks
    )


def test_a_field_that_nobody_wants_may_be_written_twice(tmp_path: Path) -> None:
    decoded = read(write(tmp_path / "log.mcap", ['{"a": 1, "b": 2, "b": 3}'] * 9), "a")
    assert decoded.values["a"].tolist() == [1] * 9


def test_a_field_that_comes_late_is_not_overlooked(tmp_path: Path) -> None:
    texts = ['{"a": 1.5}'] * 30 + ['{"a": 1.5, "b": {"c": 7}}'] * 30
    decoded = read(write(tmp_path / "log.mcap", texts, chunk_size=400), "a", "b.c")
    assert decoded.present["b.c"].tolist() == [False] * 30 + [True] * 30


def test_stamps_in_json_are_exact_and_what_is_no_json_is_left_out(tmp_path: Path) -> None:
    texts = [
        json.dumps(
            {"timestamp": {"sec": 1_700_000_000, "nsec": 999_999_990 + i}, "angle": i, "j": [{"q": i}, {"q": 9}]}
        )
        for i in range(9)
    ]
    path = write(tmp_path / "log.mcap", [*texts, "no json"])
    channels = {
        "theta": {"topic": "/lab", "field": "angle", "unit": "rad"},
        "theta_m": {"topic": "/lab", "field": "j[1].q", "unit": "rad"},
    }
    content = {"format": "mcap", "time": {"source": "header", "field": "timestamp"}, "channels": channels}
    recording = read_mcap_log(path, McapSource.model_validate({**content, "largest_loss": 0.1}))
    assert recording.facts["time"]["start_ns"] == 1_700_000_000_999_999_990
    np.testing.assert_allclose(recording.samples["time"], np.arange(9) * 1e-9, rtol=1e-12)
    assert recording.samples["theta_m"].to_list() == [9.0] * 9
    assert recording.facts["damage"]["messages_lost"] == 1
