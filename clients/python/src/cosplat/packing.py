"""Wire types as `struct.Struct`: one call for a whole element, where numpy needs one for each of its fields."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np

from . import wire

_CODES = {"u1": "B", "u4": "I", "u8": "Q", "f4": "f", "f8": "d"}


def packer(record: type[wire.Record]) -> struct.Struct:
    """All fields of a wire type in the order of memory, those of nested types and arrays one by one.

    Texts are bytes of full length, padded with zeros. Reserved bytes are written as zeros and not read.
    """
    return struct.Struct("<" + _codes(record.dtype))


def text(data: bytes) -> str:
    """A text of the wire, without its padding."""
    # Most reasons are empty.
    return data.rstrip(b"\0").decode(errors="replace") if data[0] else ""


def _codes(dtype: np.dtype[Any]) -> str:
    if dtype.subdtype is not None:
        element, shape = dtype.subdtype
        return _codes(element) * int(np.prod(shape))
    if dtype.fields is None:
        return f"{dtype.itemsize}s" if dtype.kind == "S" else _CODES[dtype.str.lstrip("<|")]
    codes, end = "", 0
    for field, offset, *_ in sorted(dtype.fields.values(), key=lambda entry: entry[1]):
        codes += f"{offset - end}x{_codes(field)}"
        end = offset + field.itemsize
    return codes + f"{dtype.itemsize - end}x"
