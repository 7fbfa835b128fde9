"""MCAP files that are legal and rare are read as the official reader does; two logs in one are refused."""

import struct
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import NonSeekingReader
from mcap_bytes import cdr, channel, chunk, header, index, log, message, messages, record, schema, statistics

from osl_analysis.errors import InputError
from osl_analysis.ingest.log_overview import inspect_mcap
from osl_analysis.ingest.message_log import McapSource, read_mcap_log
from osl_analysis.ingest.recording import Recording

PRIVATE = record(0x85, b"ours") + record(0x40, b"of a later version")
PADDING = b"\1\2\3\4\5"


def source(topic: str = "/lab", **options: Any) -> McapSource:
    channels = {"theta": {"topic": topic, "field": "a", "unit": "rad"}}
    return McapSource.model_validate({"format": "mcap", "time": {"source": "log"}, "channels": channels, **options})


def read(folder: Path, content: bytes, topic: str = "/lab", **options: Any) -> Recording:
    (folder / "log.mcap").write_bytes(content)
    return read_mcap_log(folder / "log.mcap", source(topic, **options))


def refused(folder: Path, content: bytes, topic: str = "/lab") -> str:
    """What both ingest and inspect say."""
    (folder / "log.mcap").write_bytes(content)
    said = []
    for reader in (lambda path: read_mcap_log(path, source(topic)), inspect_mcap):
        with pytest.raises(InputError) as caught:
            reader(folder / "log.mcap")
        said.append(str(caught.value))
    assert said[0] == said[1]
    assert said[0].startswith(str(folder / "log.mcap"))
    assert "\n" not in said[0]
    return said[0]


LAB = schema() + channel(1, b"/lab")
TEN = b"".join(messages(1, range(10)))
TWENTY = b"".join(messages(1, range(10, 20)))
AT = [i * len(messages(1, range(1))[0]) for i in range(10)]
ENTRIES = [(i * 1_000_000, AT[i]) for i in range(10)]

LEGAL = {
    "longer records": log(
        schema(more=PADDING) + channel(1, b"/lab", more=PADDING),
        chunk(TEN, more=PADDING) + index(1, ENTRIES, PADDING),
        chunk(TWENTY, crc=False, more=PADDING),
        summary=statistics({1: 20}, 2, PADDING),
        more=PADDING,
    ),
    "private records": log(
        PRIVATE + LAB + PRIVATE,
        chunk(PRIVATE + TEN[: AT[3]] + PRIVATE + TEN[AT[3] :] + PRIVATE) + PRIVATE,
        chunk(TWENTY) + PRIVATE,
        summary=PRIVATE + statistics({1: 20}, 2) + PRIVATE,
    ),
    "private records in a chunk with an index": log(
        LAB, chunk(TEN + PRIVATE, crc=False), index(1, ENTRIES), PRIVATE, chunk(TWENTY), summary=statistics({1: 20}, 2)
    ),
    "messages outside of the chunks": log(
        LAB, chunk(TEN), index(1, ENTRIES), TWENTY[: AT[5]], PRIVATE, TWENTY[AT[5] :], summary=statistics({1: 20}, 1)
    ),
    "no statistics": log(LAB, chunk(TEN), chunk(TWENTY)),
    "statistics without channels": log(
        LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 20}, 2, of_channels=False)
    ),
}


@pytest.mark.parametrize("content", LEGAL.values(), ids=LEGAL)
def test_a_legal_file_is_complete_and_read_as_by_the_official_reader(tmp_path: Path, content: bytes) -> None:
    recording = read(tmp_path, content, largest_loss=0.0)
    official = [struct.unpack("<d", m.data[4:])[0] for _, _, m in NonSeekingReader(BytesIO(content)).iter_messages()]
    assert recording.samples["theta"].to_list() == official == list(range(20))
    damage = recording.facts["damage"]
    assert (damage["complete"], damage["messages_lost"], damage["chunks_lost"]) == (True, 0, 0)
    assert damage["topics"] == {"/lab": {"messages": 20, "messages_lost": 0}}
    assert inspect_mcap(tmp_path / "log.mcap").facts["messages lost"] == "0"


def test_without_a_checksum_a_message_that_turned_into_a_private_record_is_lost(tmp_path: Path) -> None:
    flipped = TEN[: AT[4]] + b"\x85" + TEN[AT[4] + 1 :]
    content = log(LAB, chunk(flipped, crc=False), index(1, ENTRIES), chunk(TWENTY))
    damage = read(tmp_path, content, largest_loss=1.0).facts["damage"]
    assert (damage["complete"], damage["topics"]["/lab"]) == (False, {"messages": 19, "messages_lost": 1})


def test_the_loss_is_that_of_the_topic_and_not_of_the_file(tmp_path: Path) -> None:
    bad = [message(2, i * 1_000_000, cdr(1.0)[: 9 if i % 5 == 0 else 12]) for i in range(100)]
    two = LAB + channel(2, b"/rare")
    content = log(two, chunk(b"".join([*messages(1, range(10_000)), *bad])), summary=statistics({1: 10_000, 2: 100}, 1))
    assert len(read(tmp_path, content).samples) == 10_000
    with pytest.raises(InputError, match="20 % of topic '/rare' is lost, at most 1 % may be"):
        read(tmp_path, content, "/rare")
    damage = read(tmp_path, content, "/rare", largest_loss=0.2).facts["damage"]
    assert damage["topics"] == {"/rare": {"messages": 100, "messages_lost": 20}}
    assert damage["share_lost"] == pytest.approx(0.2)


def test_messages_of_an_undeclared_channel_are_lost_and_said(tmp_path: Path) -> None:
    damage = read(tmp_path, log(LAB, chunk(TEN + message(9, 0, cdr(1.0))))).facts["damage"]
    assert (damage["topics"]["/lab"]["messages"], damage["messages_lost"]) == (10, 1)
    assert "1 messages belong to channels that are not declared, such as 9" in damage["remarks"]


RARE = message(2, 0, cdr(1.0)) + message(2, 15_000_000, cdr(2.0))


@pytest.mark.parametrize("crc", [True, False])
def test_a_chunk_that_was_cut_out_is_counted_by_topic_from_the_statistics(tmp_path: Path, crc: bool) -> None:
    removed = chunk(TWENTY)
    two = LAB + channel(2, b"/rare")
    summary = statistics({1: 20, 2: 2}, 2)
    content = log(two, chunk(TEN + RARE), summary=summary, shift=len(removed), crc=False)
    if crc:  # the recorder's checksum was computed with the summary where it was
        whole = log(two, chunk(TEN + RARE), removed, summary=summary)
        content = whole.replace(removed, b"")
    assert len(read(tmp_path, content, "/rare").samples) == 2
    damage = read(tmp_path, content, largest_loss=1.0).facts["damage"]
    assert (damage["complete"], damage["chunks_lost"], damage["messages_lost"]) == (False, 1, 10)
    assert damage["topics"] == {"/lab": {"messages": 10, "messages_lost": 10}}
    assert f"{len(removed)} bytes are missing before the summary" in damage["remarks"]
    with pytest.raises(InputError, match="damaged or incomplete MCAP: 50 % of topic '/lab' is lost, at most 1 % may"):
        read(tmp_path, content)
    assert inspect_mcap(tmp_path / "log.mcap").facts["messages lost"] == "10"


def test_a_chunk_that_was_cut_out_without_statistics_is_an_unknown_loss(tmp_path: Path) -> None:
    removed = chunk(TWENTY)
    content = log(LAB, chunk(TEN), summary=LAB, shift=len(removed), crc=False)
    damage = read(tmp_path, content, largest_loss=1.0).facts["damage"]
    assert (damage["complete"], damage["messages_lost"]) == (False, None)
    assert damage["topics"]["/lab"]["messages_lost"] is None
    assert damage["share_lost"] > 0.1
    with pytest.raises(InputError, match="of topic '/lab' is lost"):
        read(tmp_path, content)
    assert inspect_mcap(tmp_path / "log.mcap").facts["messages lost"] == "the file does not tell"


def test_a_chunk_index_with_more_chunks_than_there_are_is_an_unknown_loss(tmp_path: Path) -> None:
    entry = record(0x08, bytes(60))
    damage = read(tmp_path, log(LAB, chunk(TEN), summary=entry + entry), largest_loss=1.0).facts["damage"]
    assert (damage["complete"], damage["chunks_lost"], damage["messages_lost"]) == (False, 1, None)


def test_more_messages_than_the_statistics_declare_are_no_complete_log(tmp_path: Path) -> None:
    content = log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 10}, 1))
    damage = read(tmp_path, content).facts["damage"]
    assert not damage["complete"]
    assert "it declares 10 messages and holds 20" in damage["remarks"]


OTHER = log(schema() + channel(1, b"/other") + channel(2, b"/lab"), chunk(b"".join(messages(1, range(30, 40)))))
FIRST = log(LAB, chunk(TEN), chunk(TWENTY), summary=statistics({1: 20}, 2))


# a cut record may end exactly with the header of the second log
ENDS = [FIRST.index(part) + len(part) - 8 - len(header()) for part in (chunk(TEN), chunk(TWENTY))]


@pytest.mark.parametrize("cut", [*range(len(log()), len(FIRST), 7), *ENDS, len(FIRST)])
def test_two_logs_in_one_file_are_refused_wherever_the_first_one_ends(tmp_path: Path, cut: int) -> None:
    assert f"holds two logs, the second from byte {cut} on: split them" in refused(tmp_path, FIRST[:cut] + OTHER)


def test_a_log_that_was_appended_without_its_magic_is_refused(tmp_path: Path) -> None:
    unfinished = FIRST[: FIRST.index(chunk(TWENTY)) + len(chunk(TWENTY))]
    assert f"holds two logs, the second from byte {len(unfinished)} on" in refused(tmp_path, unfinished + OTHER[8:])
    without_header = OTHER[8 + len(header()) :]
    assert "channel 1 is '/lab' in one part of the file and '/other' in another" in refused(
        tmp_path, unfinished + without_header
    )


def test_bytes_after_the_end_are_refused_with_the_byte_to_cut_at(tmp_path: Path) -> None:
    said = refused(tmp_path, FIRST + bytes(100))
    assert f"ends at byte {len(FIRST)} and has 100 bytes after it" in said
    assert f"`head -c {len(FIRST)}`" in said


@pytest.mark.parametrize("crc", [True, False])
@pytest.mark.parametrize("what", ["channel", "schema"])
def test_a_number_with_two_meanings_is_refused(tmp_path: Path, crc: bool, what: str) -> None:
    again = channel(1, b"/other") if what == "channel" else schema(content=b"float64 b\nfloat64 a")
    said = refused(tmp_path, log(LAB, chunk(LAB + TEN, crc=crc), chunk(again + TWENTY, crc=crc)))
    assert f"{what} 1 is " in said
    assert "two logs were joined, or the file is damaged" in said
