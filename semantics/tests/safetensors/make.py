"""Writes files of objects and vectors of words, with the package `safetensors` and by hand, and what they hold.

Run by hand with safetensors 0.8.0 and numpy 2.4.6: `python make.py .` in this folder. The package has the same core as our
reader, so that `by_hand` is a second writer: its header is neither sorted nor padded, and has a tensor that nobody knows.
"""

import json
import struct
import sys
from pathlib import Path

import numpy
from safetensors.numpy import save_file

folder = Path(sys.argv[1])
names = ["vase", 'a "table"', "größe"]
tensors = {
    "object": numpy.array([0, 1, -1, 2, 0], dtype="i4"),
    "confidence": numpy.array([1.0, 0.5, 0.0, 0.25, 1.0 / 3.0], dtype="f2"),
    "feature": numpy.arange(10).reshape(5, 2).astype("f2"),
    "object_feature": numpy.array([[0.1], [0.2], [0.3]], dtype="f4"),
    "parent": numpy.array([-1, -1, 0], dtype="i4"),
}
metadata = {
    "cosplat.objects": "1",
    "asset_hash": "123456789abcdef0",
    "names": json.dumps(names),
    "made": "by make.py",
}
save_file(tensors, folder / "full.safetensors", metadata)
least = {name: tensors[name] for name in ["object", "confidence"]}
save_file(least, folder / "least.safetensors", metadata)


def by_hand(path, tensors, metadata):
    kinds = {"i4": "I32", "f2": "F16", "f4": "F32"}
    header, values = {}, b""
    for name, array in reversed(tensors.items()):
        data = array.tobytes()
        kind = kinds[array.dtype.str[1:]]
        header[name] = {"shape": list(array.shape), "data_offsets": [len(values), len(values) + len(data)], "dtype": kind}
        values += data
    header["__metadata__"] = metadata
    text = json.dumps(header).encode()
    path.write_bytes(struct.pack("<Q", len(text)) + text + values)


by_hand(folder / "by_hand.safetensors", {**tensors, "unknown": tensors["parent"]}, metadata)
words = {"vase": numpy.array([3.0, 4.0], dtype="f4"), "a table": numpy.array([0.0, -2.0], dtype="f4")}
save_file(words, folder / "words.safetensors")
refused = {
    "kind": ({**least, "object": tensors["object"].astype("i8")}, metadata, "object is I64 [5]"),
    "axes": ({**least, "confidence": tensors["feature"]}, metadata, "confidence is F16 [5, 2]"),
    "rows": ({**least, "confidence": tensors["confidence"][:4]}, metadata, "confidence has 4 rows, expected 5"),
    "version": (least, {**metadata, "cosplat.objects": "2"}, "version 2, expected 1"),
    "no_names": (least, {"cosplat.objects": "1", "asset_hash": "0"}, '"names"'),
    "no_metadata": (least, None, '"cosplat.objects"'),
}
for name, (tensors_of, metadata_of, _) in refused.items():
    save_file(tensors_of, folder / f"{name}.safetensors", metadata_of)
told = {
    "names": names,
    "rows": {name: [float(x) for x in array.flatten()] for name, array in tensors.items()},
    "refused": {name: words for name, (_, _, words) in refused.items()},
}
(folder / "told.json").write_text(json.dumps(told, indent=1) + "\n")
