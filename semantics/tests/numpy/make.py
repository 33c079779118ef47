"""Writes arrays as numpy saves them, and what they hold.

Run by hand with numpy 2.4.6: `python make.py .` in this folder.
"""

import json
import sys
from pathlib import Path

import numpy
from numpy.lib import format as npy

folder = Path(sys.argv[1])
told = {"accepted": {}, "refused": {}}


def write(name, array, version=None):
    with open(folder / f"{name}.npy", "wb") as file:
        npy.write_array(file, array, version)


def accepted(name, array, version=None):
    write(name, array, version)
    values = [float(x) for x in array.flatten(order="C")]
    told["accepted"][name] = {"whole": array.dtype.kind in "bui", "shape": array.shape, "values": values}


def refused(name, array, words, version=None):
    write(name, array, version)
    told["refused"][name] = words


whole = numpy.array([[0, 1, 2], [100, 127, 5]])
for kind in ["b1", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8"]:
    array = whole.astype(kind)
    if kind[0] == "i":
        array[0, 1:] = [-1, numpy.iinfo(kind).min if kind != "i8" else -(2**31)]
    accepted(kind, array)
parts = numpy.array([[0.5, -1.0], [0.0, 1.0 / 3.0], [1e-7, -65504.0]])
for kind in ["f2", "f4", "f8"]:
    # What float32 holds of it.
    accepted(kind, parts.astype("f4").astype(kind) if kind == "f8" else parts.astype(kind))
solid = numpy.arange(24).reshape(2, 3, 4)
accepted("fortran_i4", numpy.asfortranarray(solid.astype("i4")))
accepted("transposed_u1", whole.astype("u1").T)
accepted("fortran_f4", numpy.asfortranarray(parts.astype("f4")))
for major in [1, 2, 3]:
    accepted(f"version_{major}_i4", solid.astype("i4"), (major, 0))
    accepted(f"version_{major}_f2", parts.astype("f2"), (major, 0))
accepted("line", numpy.array([7, 8, 9], dtype="i4"))
accepted("single", numpy.array(7, dtype="i4"))
accepted("nothing", numpy.zeros((0, 3), dtype="i4"))
refused("big_endian", whole.astype(">i4"), ">i4")
refused("complex", parts.astype("c8"), "<c8")
refused("words", numpy.array(["a", "vase"]), "<U4")
refused("times", numpy.array([1, 2], dtype="m8[s]"), "<m8[s]")
refused("records", numpy.zeros(2, dtype=[("label", "i4"), ("größe", "f4")]), "records", (3, 0))
refused("pickle", numpy.array([{"a": 1}], dtype=object), "|O")
refused("large", numpy.array([2**31], dtype="i8"), "32 bits")
refused("large_fraction", numpy.array([1e39]), "finite")
refused("not_a_number", numpy.array([0.0, numpy.nan], dtype="f4"), "finite")
(folder / "told.json").write_text(json.dumps(told, indent=1) + "\n")
