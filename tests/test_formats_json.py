"""JSON messages: every number stands at its path, what is absent is null, and what is no number is lost and said."""

import json
from pathlib import Path
from typing import Any

import pytest
from mcap_builder import assert_decoded, write_payloads

from osl_analysis.errors import InputError
from osl_analysis.formats.mcap import read_mcap
from osl_analysis.formats.messages import Decoded, decode_topics
from osl_analysis.ingest.raw_files import FORMATS


def write(path: Path, texts: list[str], chunk_size: int = 1 << 20) -> Path:
    return write_payloads(path, [text.encode() for text in texts], "json", chunk_size=chunk_size)


def read(path: Path, *fields: str) -> Decoded:
    return decode_topics(read_mcap(path), {"/lab": fields}, fields)["/lab"]


SHAPES: list[tuple[Any, dict[str, float | bool]]] = [
    ({"a": 1.5, "b": {"c": 2}, "d": [1, 2.5], "e": True}, {"a": 1.5, "b.c": 2, "d[1]": 2.5, "e": True}),
    ({"a": None, "b": {}, "d": [3]}, {}),
    ({"b": {"c": -(2**62), "a": 9}, "d": []}, {"b.c": -(2**62)}),
    ({"a": -7, "b": None, "d": [None, 4], "e": False}, {"a": -7, "d[1]": 4, "e": False}),
]


@pytest.mark.parametrize("indent", [None, 1])
def test_messages_of_different_shapes_stay_in_order_with_what_each_has(tmp_path: Path, indent: int | None) -> None:
    order = [0, 0, 1, 3, 2, 1, 0, 3, 3, 2]
    path = write(tmp_path / "log.mcap", [json.dumps(SHAPES[k][0], indent=indent) for k in order], chunk_size=200)
    assert_decoded(path, "/lab", [SHAPES[k][1] for k in order])


@pytest.mark.parametrize("base", [2**53, -(2**53), 2**63])
def test_an_integer_beyond_a_floats_reach_is_exact_in_every_chunk(tmp_path: Path, base: int) -> None:
    texts = [json.dumps({"a": base + 1 + 2 * i if i % 7 else i}) for i in range(60)]
    decoded = read(write(tmp_path / "log.mcap", texts, chunk_size=400), "a")
    assert decoded.values["a"].tolist() == [json.loads(text)["a"] for text in texts]


def ingested(path: Path, **channel: str) -> Any:
    channels = {"theta": {"topic": "/lab", "field": "x", "unit": "rad", **channel}}
    described = {"format": "mcap", "time": {"source": "log"}, "largest_loss": 0.3, "channels": channels}
    return FORMATS["mcap"].read(path, FORMATS["mcap"].source.model_validate(described))


@pytest.mark.parametrize(
    ("field", "wrong", "said"),
    [
        ("x", "no json", "a message of 7 bytes is not JSON: Expecting value"),
        ("x", '{"x": "a"}', "field 'x' is \"a\", not a number, in message 2"),
        ("x", '{"x": true}', "field 'x' is true, not a number as elsewhere, in message 2"),
        ("x", '{"x": [1, 2]}', "field 'x' is an array of 2, not one number, in message 2"),
        ("x.y", '{"x": 3}', "field 'x' is 3, not an object with fields, in message 2"),
        ("v[n=b]", '{"v": [1, "c"], "n": ["a", "b"]}', "field 'v[n=b]' is \"c\", not a number, in message 2"),
    ],
)
def test_a_message_without_a_number_in_a_field_is_lost_and_said(
    tmp_path: Path, field: str, wrong: str, said: str
) -> None:
    right = {"x": '{"x": 1.5, "on": true}', "z": '{"z": 1.5}', "x.y": '{"x": {"y": 1.5}}', "x[1]": '{"x": [0, 1.5]}'}
    sound = right.get(field, '{"v": [0, 1.5], "n": ["a", "b"]}')
    path = write(tmp_path / "log.mcap", [sound, wrong, *[sound] * 9], chunk_size=100)
    recording = ingested(path, field=field)
    assert recording.samples["theta"].to_list() == [1.5] * 10
    assert recording.facts["damage"]["topics"]["/lab"] == {"messages": 11, "messages_lost": 1}
    assert recording.facts["damage"]["remarks"][0].startswith(f"1 of 11 messages of topic '/lab' are lost: {said}")
    with pytest.raises(InputError) as caught:
        ingested(write(tmp_path / "log.mcap", [sound, *[wrong] * 9]), field=field)
    assert "messages that cannot be used: 90 % of topic '/lab' is lost, at most 30 %" in str(caught.value)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"x": "1"}', "field 'x' is \"1\", not a number, in message 1"),
        ('{"x": [1, 2]}', "field 'x' is an array of 2, not one number, in message 1 (it has x[0..1])"),
        ('{"x": true}', "field 'x' is true in message 1 of 9, a truth value and no number in rad"),
    ],
)
def test_a_field_that_is_no_number_anywhere_is_blamed_on_the_source_file(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError) as caught:
        ingested(write(tmp_path / "log.mcap", [text] * 9))
    assert f"topic '/lab': {said}" in str(caught.value)
    assert "`field` in the source file" in str(caught.value)
    assert "damaged" not in str(caught.value)


def test_values_that_are_absent_are_counted_and_said(tmp_path: Path) -> None:
    recording = ingested(write(tmp_path / "log.mcap", ['{"x": 1.5}', '{"x": null}', "{}"]))
    assert recording.samples["theta"].to_list() == [1.5, None, None]
    said = "topic '/lab': field 'x' has no value in 2 of 3 messages, first message 2"
    assert any(said in warning for warning in recording.warnings)


@pytest.mark.parametrize("wrong", ["null", "1.5", "true", "1e300", "9223372036854775808"])
def test_a_counter_that_does_not_count_is_refused_and_not_taken_for_zero(tmp_path: Path, wrong: str) -> None:
    texts = ['{"x": 1.5, "seq": 7}', f'{{"x": 1.5, "seq": {wrong}}}'] * 2
    with pytest.raises(InputError, match=r"'seq'.* in message 2"):
        ingested(write(tmp_path / "log.mcap", texts), counter="seq")
