"""The Python types are those of the wire, byte for byte."""

import re
from pathlib import Path

import numpy as np
from cosplat import LAWS, LaunchedSession, wire

DOCUMENT = (Path(__file__).parents[3] / "docs/wire-format.md").read_text()


def table() -> list[tuple[str, int, int, str, str, int, int]]:
    """Type, size, alignment, field, Rust type, offset, size: the server's own types, to which a test holds the document."""
    rows = []
    for name, size, alignment, text in re.findall(
        r"^### `(.*)`: (\d+) bytes, alignment (\d+)\n((?:[^#\n].*\n|\n)*)", DOCUMENT, re.MULTILINE
    ):
        for offset, field_size, field, rust in re.findall(r"^\| (\d+) \| (\d+) \| `(\w+)` \| `(.*)` \|$", text, re.MULTILINE):
            rows.append((name, int(size), int(alignment), field, rust, int(offset), int(field_size)))
    return rows


ROWS = table()


def test_every_field_is_where_the_server_has_it() -> None:
    types: dict[str, set[str]] = {}
    for name, size, alignment, field, _, offset, field_size in ROWS:
        record: type[wire.Record] = getattr(wire, name.rpartition(".")[2])
        assert (record.type_name, record.dtype.itemsize, record.alignment) == (name, size, alignment)
        fields = types.setdefault(name, set())
        assert record.dtype.fields is not None
        if field != "reserved":
            kind, at = record.dtype.fields[field][:2]
            assert (at, kind.itemsize) == (offset, field_size), f"{name}.{field}"
            fields.add(field)
    for name, fields in types.items():
        assert fields == set(getattr(wire, name.rpartition(".")[2]).dtype.names)
    records = {record.type_name for record in wire.Record.__subclasses__() if hasattr(record, "dtype")}
    assert records == set(types), "types that the server does not have, or that are missing"


def test_kinds_of_numbers_are_those_of_the_server() -> None:
    kinds = {"u8": "u1", "u32": "<u4", "u64": "<u8", "f32": "<f4", "f64": "<f8"}
    for name, _, _, field, rust, _, _ in ROWS:
        record: type[wire.Record] = getattr(wire, name.rpartition(".")[2])
        kind = record.dtype[field] if field != "reserved" else None
        element = rust.strip("[]").split(";")[0]
        if kind is not None and element in kinds and kind.kind != "S":
            assert kind.base == np.dtype(kinds[element]), f"{name}.{field}"


def test_the_hash_is_that_of_the_table_and_of_a_server(session: LaunchedSession) -> None:
    state = 0xCBF29CE484222325
    for row in ROWS:
        for byte in (" ".join(map(str, row)) + "\n").encode():
            state = (state ^ byte) * 0x100000001B3 % 2**64
    assert wire.SCHEMA_HASH == state == session.hello.schema_hash


def test_laws_are_those_of_the_wire_format() -> None:
    rows = re.findall(r"^\| (\d+) \| `(\w+)` \| (.*)\|$", DOCUMENT, re.MULTILINE)
    assert {name: (int(n), tuple(re.findall(r"`(\w+)`", words))) for n, name, words in rows} == LAWS
