"""Reads a recording with the reference reader and prints what it found as JSON.

Arguments: the recording, and a file with what was published: per step the step (u64), the number of Gaussians (u64)
and their positions (3 float32 each), little-endian.
"""

import hashlib
import json
import struct
import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

expected = {}
with open(sys.argv[2], "rb") as file:
    while head := file.read(16):
        step, count = struct.unpack("<QQ", head)
        expected[step] = file.read(12 * count)

report = {"steps": [], "wrong": [], "counts": {}, "schemas": {}, "frames_of": {}}
with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    for schema, channel, message, decoded in reader.iter_decoded_messages(
        topics=["/gaussians", "/objects/tf"], log_time_order=False
    ):
        if channel.topic == "/objects/tf":
            report["frames_of"][message.sequence] = [
                [t.child_frame_id, t.translation.x, t.rotation.w] for t in decoded.transforms
            ]
            continue
        offset = {field.name: field.offset for field in decoded.fields}
        stride, data = decoded.point_stride, decoded.data
        axes = [offset["x"], offset["y"], offset["z"]]
        positions = b"".join(
            data[at + axis : at + axis + 4] for at in range(0, len(data), stride) for axis in axes
        )
        report["steps"].append(message.sequence)
        if positions != expected[message.sequence]:
            report["wrong"].append(message.sequence)
    journal = []
    for schema, channel, message in reader.iter_messages(log_time_order=False):
        report["counts"][channel.topic] = report["counts"].get(channel.topic, 0) + 1
        report["schemas"][channel.topic] = [schema.name, schema.encoding]
        if channel.topic == "/journal":
            journal.append(json.loads(message.data)["step"])
    report["journal"] = journal
    report["attachments"] = {
        a.name: hashlib.sha256(a.data).hexdigest() for a in reader.iter_attachments()
    }
    report["ply"] = next(
        (a.data[:36].decode("ascii") for a in reader.iter_attachments() if a.name == "scene.ply"), None
    )
    report["toml"] = next(
        (a.data.decode() for a in reader.iter_attachments() if a.name == "scene.toml"), None
    )
    report["metadata"] = [m.metadata for m in reader.iter_metadata() if m.name == "cosplat.run"]
    summary = reader.get_summary()
    report["message_count"] = summary.statistics.message_count
print(json.dumps(report))
