"""MATLAB files for tests: version 5 by scipy and byte by byte, version 7.3 by h5py as MATLAB lays it out."""

import struct
import zlib
from pathlib import Path

import h5py
import numpy as np
import scipy.io

HEADER5 = b"MATLAB 5.0 MAT-file, made for a test".ljust(124) + b"\x00\x01IM"
HEADER73 = b"MATLAB 7.3 MAT-file, made for a test".ljust(124) + b"\x00\x02IM"


def write_mat(path: Path, compressed: bool = True, **variables: object) -> Path:
    """A file of version 5."""
    scipy.io.savemat(path, variables, do_compression=compressed)
    return path


def part(kind: int, content: bytes) -> bytes:
    """A part of version 5 with its tag, padded."""
    return struct.pack("<II", kind, len(content)) + content + bytes(-len(content) % 8)


def matrix(name: str, kind: int, dimensions: tuple[int, ...], content: bytes, flags: int = 0) -> bytes:
    """A matrix of version 5 with its tag, which may declare what it does not hold."""
    sizes = struct.pack(f"<{len(dimensions)}i", *dimensions)
    head = part(6, struct.pack("<II", kind | flags, 0)) + part(5, sizes) + part(1, name.encode())
    return part(14, head + content)


def opaque(name: str, class_name: str) -> bytes:
    """An object of a class of MATLAB's own, such as a table."""
    names = b"".join(part(1, text.encode()) for text in (name, "MCOS", class_name))
    inside = matrix("", 13, (2, 1), part(6, struct.pack("<II", 0xDD000000, 2)))
    return part(14, part(6, struct.pack("<II", 17, 0)) + names + inside)


def compressed(content: bytes) -> bytes:
    """A compressed variable with its tag, which is not padded."""
    packed = zlib.compress(content, 9)
    return struct.pack("<II", 15, len(packed)) + packed


def write_parts(path: Path, *parts: bytes) -> Path:
    """A file of version 5 of these parts."""
    path.write_bytes(HEADER5 + b"".join(parts))
    return path


def write_mat73(path: Path, **variables: object) -> Path:
    """A file of version 7.3: dicts become structs, lists of dicts arrays of structs, tuples cells, str text."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, value in variables.items():
            put(file, name, value)
    with path.open("r+b") as raw:
        raw.write(HEADER73)
    return path


def put(group: h5py.Group, name: str, value: object) -> h5py.Group | h5py.Dataset:
    """One value of a file of version 7.3."""
    if isinstance(value, dict):
        item = group.create_group(name)
        item.attrs["MATLAB_class"] = np.bytes_("struct")
        for field, content in value.items():
            put(item, field, content)
    elif isinstance(value, list):
        item = group.create_group(name)
        item.attrs["MATLAB_class"] = np.bytes_("struct")
        for field in value[0]:
            references = [referred(group.file, one[field]) for one in value]
            item.create_dataset(field, data=np.array([references], dtype=h5py.ref_dtype).T)
    elif isinstance(value, tuple):
        references = [referred(group.file, one) for one in value]
        item = group.create_dataset(name, data=np.array([references], dtype=h5py.ref_dtype).T)
        item.attrs["MATLAB_class"] = np.bytes_("cell")
    elif isinstance(value, str):
        item = group.create_dataset(name, data=np.array([[ord(sign)] for sign in value], dtype=np.uint16))
        item.attrs["MATLAB_class"] = np.bytes_("char")
    else:
        array = np.atleast_2d(np.asarray(value))
        stored = array.T
        if array.dtype.kind == "c":
            stored = np.zeros(array.T.shape, dtype=[("real", "f8"), ("imag", "f8")])
            stored["real"], stored["imag"] = array.T.real, array.T.imag
        item = group.create_dataset(name, data=stored)
        item.attrs["MATLAB_class"] = np.bytes_("double")
    return item


def referred(file: h5py.File, value: object) -> h5py.Reference:
    """A reference to a value among `#refs#`."""
    group = file.require_group("#refs#")
    return put(group, f"r{len(group)}", value).ref
