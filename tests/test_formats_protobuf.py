"""Protobuf: every number of a message stands at its path, and what is not written is null, not zero."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass
from mcap.writer import CompressionType
from mcap_builder import assert_decoded, write_payloads

from osl_analysis.commands.inspect import inspect_file
from osl_analysis.errors import InputError
from osl_analysis.ingest.raw_files import FORMATS
from osl_analysis.ingest.source import Source

MILLISECOND = 1_000_000

SCALARS = {
    "double": -1e300, "float": 0.1, "bool": True, "int32": -(2**31), "int64": -(2**63), "uint32": 2**32 - 1,
    "uint64": 2**64 - 1, "sint32": -(2**31), "sint64": 2**63 - 1, "fixed32": 2**32 - 1, "fixed64": 2**64 - 1,
    "sfixed32": -1, "sfixed64": -(2**63),
}  # fmt: skip
"""Types of numbers, with a value that not all of them can hold."""


def descriptors() -> FileDescriptorSet:
    """`lab.Sample`: each scalar alone, optional and in an array, messages, names, a oneof."""
    file = FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    stamp, sample, entry = (file.message_type.add(name=name) for name in ("Stamp", "Sample", "Note"))
    kind = FieldDescriptorProto

    def add(message: Any, name: str, of: int, **options: Any) -> Any:
        return message.field.add(name=name, number=len(message.field) + 1, type=of, **{"label": 1, **options})

    add(stamp, "seconds", kind.TYPE_INT64)
    add(stamp, "nanos", kind.TYPE_INT32)
    add(entry, "text", kind.TYPE_STRING)
    add(sample, "stamp", kind.TYPE_MESSAGE, type_name=".lab.Stamp")
    add(sample, "name", kind.TYPE_STRING, label=3)
    add(sample, "note", kind.TYPE_MESSAGE, type_name=".lab.Note", label=3)
    add(sample, "history", kind.TYPE_MESSAGE, type_name=".lab.Stamp", label=3)
    add(sample, "choice_a", kind.TYPE_DOUBLE, oneof_index=0)
    add(sample, "choice_b", kind.TYPE_MESSAGE, type_name=".lab.Stamp", oneof_index=0)
    sample.oneof_decl.add(name="choice")
    for scalar in SCALARS:
        of = getattr(kind, f"TYPE_{scalar.upper()}")
        add(sample, f"one_{scalar}", of)
        add(sample, f"packed_{scalar}", of, label=3)
        add(sample, f"maybe_{scalar}", of, proto3_optional=True, oneof_index=len(sample.oneof_decl))
        sample.oneof_decl.add(name=f"_maybe_{scalar}")
    return FileDescriptorSet(file=[file])


def sample_class() -> Any:
    pool = DescriptorPool()
    pool.Add(descriptors().file[0])
    return GetMessageClass(pool.FindMessageTypeByName("lab.Sample"))


Sample = sample_class()


def numbers(message: Message, prefix: str = "") -> dict[str, float]:
    """Every number of a decoded message, by path; a field that tells whether it is there counts only if it is."""
    found: dict[str, float] = {}
    for item in message.DESCRIPTOR.fields:
        path, value = prefix + item.name, getattr(message, item.name)
        if item.is_repeated:
            for i, one in enumerate(value):
                found |= numbers(one, f"{path}[{i}].") if item.message_type else {f"{path}[{i}]": one}
        elif not item.has_presence or message.HasField(item.name):
            found |= numbers(value, f"{path}.") if item.message_type else {path: value}
    return {path: value for path, value in found.items() if isinstance(value, int | float)}


def write(path: Path, payloads: list[bytes], **options: Any) -> Path:
    schema = "lab.Sample", "protobuf", descriptors().SerializeToString()
    return write_payloads(path, payloads, "protobuf", *schema, **options)


def test_messages_of_any_shape_equal_googles_decoder(tmp_path: Path) -> None:
    alone = {f"one_{scalar}": value for scalar, value in SCALARS.items()}
    maybe = {f"maybe_{scalar}": value for scalar, value in SCALARS.items()}
    arrays = {f"packed_{scalar}": [value, 0, 1] for scalar, value in SCALARS.items()}
    stamps = {"stamp": {"seconds": 2**40}, "history": [{}, {"nanos": 5}], "choice_a": 2.5}
    contents = [alone | maybe, {}, arrays, stamps, alone | stamps, {"name": ["é"], "note": [{"text": "b"}]}, {}]
    messages = [Sample(**content) for content in contents]
    path = write(tmp_path / "log.mcap", [message.SerializeToString() for message in messages], chunk_size=400)
    expected = [numbers(message) for message in messages]
    assert_decoded(path, "/lab", expected)
    assert sum(len(values) for values in expected) >= len(SCALARS) * len(messages)


def source(**channels: str) -> Source:
    full = {column: {"topic": "/lab", "field": field, "unit": "rad"} for column, field in channels.items()}
    content = {"format": "mcap", "time": {"source": "header", "field": "stamp"}, "channels": full}
    return FORMATS["mcap"].source.model_validate(content)


def stamped(i: int, **fields: Any) -> bytes:
    return bytes(Sample(stamp={"seconds": 1_700_000_000, "nanos": i * 300 * MILLISECOND}, **fields).SerializeToString())


def test_a_field_that_is_optional_is_null_where_absent_and_one_that_is_not_is_zero(tmp_path: Path) -> None:
    payloads = [stamped(0, maybe_double=0.0), stamped(1), stamped(2, maybe_double=2.0, one_double=5.0)]
    path = write(tmp_path / "log.mcap", payloads)
    read = FORMATS["mcap"].read(path, source(theta="maybe_double", theta_m="one_double")).samples
    assert read["theta"].to_list() == [0.0, None, 2.0]
    assert read["theta_m"].to_list() == [0.0, 0.0, 5.0]
    np.testing.assert_allclose(read["time"], [0.0, 0.3, 0.6], rtol=1e-15)


def test_a_message_that_google_refuses_is_left_out_and_reported(tmp_path: Path) -> None:
    payloads = [stamped(i, one_double=1.0) for i in range(3)]
    payloads[1] = payloads[1][:-3]
    path = write(tmp_path / "log.mcap", payloads, compression=CompressionType.NONE)
    recording = FORMATS["mcap"].read(path, source(theta="one_double").model_copy(update={"largest_loss": 0.5}))
    assert len(recording.samples) == 2
    assert recording.facts["damage"]["messages_lost"] == 1
    with pytest.raises(InputError, match="1 of 3 messages of topic '/lab' are lost: a message of"):
        FORMATS["mcap"].read(path, source(theta="one_double"))


def test_fields_are_listed_with_their_types_lengths_and_names(tmp_path: Path) -> None:
    message = stamped(0, name=["hip", "toe"], packed_double=[1.0, 2.0], packed_uint64=[5, 300, 7], one_sint32=1)
    channels = inspect_file(write(tmp_path / "log.mcap", [message])).channels
    listed = {"packed_double[name=toe]": "float64[2]", "packed_uint64[0]": "uint64[3]", "one_sint32": "int32"}
    assert listed.items() <= {one.address["field"]: one.type for one in channels}.items()
