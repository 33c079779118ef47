"""Whatever a file or a gateway holds, its reader raises what it promises and nothing else."""

import io
import json
import os
import random
import socket
import struct
import subprocess
import threading
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from conftest import PATIENCE
from cosplat import BadName, CosplatError, Domain, LaunchedSession, Malformed, Pause, Push, Recording, RecordingDamaged, Resume
from cosplat import Stop, SweepFailed, Unanswered, launch, remote, sweep
from cosplat.remote import Remote
from mcap.records import Attachment, Channel, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, Writer
from test_recording import record

# A soft block and a body, with few Gaussians.
SCENE = """
version = 1
name = "two small blocks"
frame_rate = 50
dx = 0.1

[[objects]]
name = "soft"
shape = { kind = "box", size = [0.1, 0.1, 0.1] }
translation = [-0.3, 0.1, 0.0]
material = "soft_rubber"

[[objects]]
name = "body"
shape = { kind = "box", size = [0.1, 0.1, 0.1] }
translation = [0.3, 0.1, 0.0]
rotation_deg = [20, 0, 35]
material = "rigid"
"""

ROUNDS = int(os.environ.get("COSPLAT_FUZZ_ROUNDS", "100"))

DEEP = "[" * 100_000
VALUES: list[Any] = [None, True, -1, 3, 1.5, 2**32 - 1, 2**63, 2**64, 10**400, float("inf"), "", "x", "0", "nan", "f" * 20]
VALUES += [[], [0], [None] * 13, [[1]] * 3, {}, {"a": 1}]
TEXTS = ["", "x", "-1", "1e400", "9" * 20, "9" * 5000, DEEP, "null", "[1]", "1.5", "true", "4294967295"]


def other_json(value: Any, random: random.Random) -> Any:
    """A JSON value with another one somewhere in it."""
    if isinstance(value, dict) and value and random.random() < 0.8:
        key, value = random.choice(list(value)), dict(value)
        if random.random() < 0.15:
            del value[key]
        else:
            value[key] = other_json(value[key], random)
        return value
    if isinstance(value, list) and value and random.random() < 0.7:
        index, value = random.randrange(len(value)), list(value)
        value[index] = other_json(value[index], random)
        return value
    return random.choice(VALUES)


def other_bytes(data: bytes, random: random.Random) -> bytes:
    """Bytes that are cut, overwritten or have something put in."""
    at, what = random.randrange(len(data) + 1), random.randrange(5)
    if what == 0:
        return data[:at]
    if what == 1:
        return DEEP.encode()
    if what == 2:
        return data[:at] + b"\xff" * random.choice([1, 9, 10, 11, 1000]) + data[at:]
    # Where numbers and names are.
    at = min(at, len(data) - 1) if what == 3 else random.randrange(min(len(data), 64))
    return data[:at] + bytes([data[at] ^ 1 << random.randrange(8)]) + data[at + 1 :] if data else b"\0"


def other_message(message: Message, random: random.Random) -> Message:
    what = random.randrange(5)
    if what == 0:
        message.sequence = random.choice([0, 1, 2**32 - 1])
    elif what == 1:
        message.log_time = random.choice([0, 2**63, 2**64 - 1, message.log_time + 10**9])
    elif message.data[:1] == b"{" and what < 4:
        message.data = json.dumps(other_json(json.loads(message.data), random)).encode()
    else:
        message.data = other_bytes(message.data, random)
    return message


def other_channel(channel: Channel, random: random.Random) -> Channel:
    topics = [channel.topic, "/status", "/places", "/gaussians", "/gaussians/x", "/gaussians/" + "9" * 5000]
    channel.topic = random.choice(topics)
    channel.message_encoding = random.choice([channel.message_encoding, "cosplat.packed", "json"])
    return channel


def other_record(found: McapRecord, random: random.Random) -> McapRecord:
    if isinstance(found, Message):
        return other_message(found, random)
    if isinstance(found, Channel):
        return other_channel(found, random)
    if isinstance(found, Metadata) and found.metadata:
        key = random.choice(list(found.metadata))
        found.metadata[key] = random.choice(TEXTS)
        if random.random() < 0.2:
            del found.metadata[key]
    elif isinstance(found, Attachment):
        found.name = random.choice([found.name] * 3 + ["other"])
        found.data = other_bytes(found.data, random)
    return found


def other_recording(whole: bytes, random: random.Random) -> bytes:
    """A recording with right checksums whose records say something else in one to five places, topics equally often."""
    records = []
    for found in StreamReader(io.BytesIO(whole)).records:
        if isinstance(found, DataEnd):
            break
        records.append(found)
    topics = {found.id: found.topic for found in records if isinstance(found, Channel)}
    groups: dict[object, list[int]] = defaultdict(list)
    for number, found in enumerate(records):
        if isinstance(found, Message | Metadata | Attachment | Channel):
            groups[type(found), topics.get(getattr(found, "channel_id", -1))].append(number)
    hit = {random.choice(random.choice(list(groups.values()))) for _ in range(random.choice([1, 1, 2, 5]))}
    file = io.BytesIO()
    writer = Writer(file, compression=CompressionType.NONE)
    writer.start("cosplat")
    schemas, channels = {0: 0}, {}
    for number, found in enumerate(records):
        found = other_record(found, random) if number in hit else found
        if isinstance(found, Schema):
            schemas[found.id] = writer.register_schema(found.name, found.encoding, found.data)
        elif isinstance(found, Channel):
            schema = schemas[found.schema_id]
            channels[found.id] = writer.register_channel(found.topic, found.message_encoding, schema, found.metadata)
        elif isinstance(found, Message):
            writer.add_message(channels[found.channel_id], found.log_time, found.data, found.publish_time, found.sequence)
        elif isinstance(found, Metadata):
            writer.add_metadata(found.name, found.metadata)
        elif isinstance(found, Attachment):
            writer.add_attachment(found.create_time, found.log_time, found.name, found.media_type, found.data)
    writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def other_file(whole: bytes, random: random.Random) -> bytes:
    """A file that is cut, or has other bytes; half of the time in its index, which has no checksums."""
    if random.random() < 0.2:
        return whole[: random.randrange(len(whole))]
    data, first = bytearray(whole), random.choice([0, max(0, len(whole) - 4000)])
    for _ in range(random.choice([1, 1, 3, 20])):
        at = random.randrange(first, len(data))
        data[at] = random.choice([0, 255, data[at] ^ 1 << random.randrange(8)])
    return bytes(data)


def damages(path: Path) -> list[RecordingDamaged]:
    """Reads all that there is in a file, and returns what is said about it."""
    said = []

    def tried(read: Callable[[], object]) -> None:
        try:
            read()
        except RecordingDamaged as damage:
            said.append(damage)

    for run in (0, -1):
        with Recording(path, run) as recording:
            for whole in (recording.journal, recording.gaps, recording.scene, lambda: recording.names):
                tried(whole)
            tried(lambda: list(recording.frames()))
            for step in recording.steps.tolist():
                tried(lambda: recording.frame(step))
                tried(lambda: recording.objects(step))
    return said


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """A recording, and the same compacted."""
    folder = tmp_path_factory.mktemp("damage")
    domain = Domain(folder / "d")
    with launch(SCENE, pace="free", paused=True, domain=domain) as session:
        recorder = record(session, folder / "run.mcap")
        session.send(Push("soft", (0, 0.1, 0), at_step=2), Resume(), Stop(at_step=6))
        assert recorder.wait(PATIENCE) == 0
    subprocess.run([os.environ["COSPLAT"], "compact", folder / "run.mcap", "-o", folder / "packed.mcap"], check=True)
    whole = [(folder / name).read_bytes() for name in ("run.mcap", "packed.mcap")]
    for name in ("run.mcap", "packed.mcap"):
        assert damages(folder / name) == []
    return whole


@pytest.mark.parametrize("change", [other_recording, other_file])
def test_a_damaged_recording_is_called_one(
    recordings: list[bytes], tmp_path: Path, change: Callable[[bytes, random.Random], bytes]
) -> None:
    path, damaged = tmp_path / "other.mcap", 0
    for seed in range(ROUNDS):
        chance = random.Random(seed)
        path.write_bytes(change(chance.choice(recordings), chance))
        try:
            damaged += bool(damages(path))
        except (RecordingDamaged, BadName):
            damaged += 1
        except Exception as error:
            raise AssertionError(f"{change.__name__} with seed {seed}") from error
    assert damaged > ROUNDS // 3


def test_what_is_no_file_or_unpacks_to_too_much_is_no_recording(recordings: list[bytes], tmp_path: Path) -> None:
    zstandard = pytest.importorskip("zstandard")
    os.mkfifo(tmp_path / "pipe")
    for name in (tmp_path / "pipe", tmp_path, Path("/dev/zero")):
        with pytest.raises(RecordingDamaged, match="it is no regular file"):
            Recording(name)
    path = tmp_path / "bomb.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("cosplat")
        channel = writer.register_channel("/status", "json", 0)
        writer.add_message(channel, 1, b"{}", 1)
        writer.add_metadata("cosplat.run", {"epoch": "5"})
        writer.finish()  # type: ignore[no-untyped-call]
    whole = path.read_bytes()
    # A chunk of a gigabyte of zeros in place of the one that is there, and the index is told where it is.
    [summary] = struct.unpack_from("<Q", whole, len(whole) - 28)
    bomb = zstandard.compress(bytes(1 << 30))
    for told in (1 << 30, 16):
        chunk = struct.pack("<QQQII4sQ", 0, 2, told, zlib.crc32(b""), 4, b"zstd", len(bomb)) + bomb
        index = b"\x08" + struct.pack("<QQQQQIQI4sQQ", 64, 0, 2, summary, len(chunk) + 9, 0, 0, 4, b"zstd", len(bomb), told)
        footer = b"\x02" + struct.pack("<QQQI", 20, summary + 9 + len(chunk), 0, 0)
        path.write_bytes(whole[:summary] + b"\x06" + struct.pack("<Q", len(chunk)) + chunk + index + footer + whole[-8:])
        with pytest.raises(RecordingDamaged, match="a chunk unpacks to 1073741824 bytes, expected at most"):
            Recording(path)


def test_a_closed_recording_says_so(recordings: list[bytes], tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(recordings[0])
    recording = Recording(path)
    recording.close()
    reads: list[Callable[[], object]] = [recording.scene, recording.journal, lambda: recording.frame(3)]
    for read in reads:
        with pytest.raises(ValueError, match="the recording .* is closed") as error:
            read()
        assert not isinstance(error.value, RecordingDamaged)


@contextmanager
def gateway_that_says(answer: bytes) -> Iterator[tuple[str, int]]:
    """A gateway that answers each request with the same bytes, and hangs up."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            while True:
                try:
                    connection, _ = listener.accept()
                except OSError:
                    return
                with connection, connection.makefile("rb") as requests:
                    try:
                        requests.readline()
                        connection.sendall(answer)
                    except OSError:
                        # It heard enough.
                        pass

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield listener.getsockname()[:2]
        listener.shutdown(socket.SHUT_RDWR)
        thread.join(PATIENCE)


HELLO = {"wire_version": 1, "schema_hash": 1, "pid": 1, "epoch": 1, "recorded_first": 0, "recorded_last": 0, "server_version": "1"}
ANSWERS = [
    DEEP,
    "",
    "x" * (2 << 20),
    "5",
    "null",
    '"error"',
    "[]",
    "{}",
    '{"error": 3}',
    '{"error": {"kind": [], "words": 5}}',
    '{"error": {"kind": "Malformed"}}',
    '{"acks": 5}',
    '{"acks": [[1, 2]]}',
    '{"acks": [[1, 1, false, 5]]}',
    '{"acks": [["x", null, true, ""]]}',
    '{"session": "s", "hello": 5}',
    '{"session": "s", "hello": {}}',
    *(json.dumps({"session": "s", "hello": {**HELLO, "pid": value}}) for value in VALUES[4:] if value != {}),
    json.dumps({"session": "s", "hello": {**HELLO, "server_version": 5}}),
    json.dumps({"session": "a/b", "hello": HELLO}),
    '{"scene": 5, "sizes": [0, 0, 0, 0, 0]}',
    '{"scene": {}, "sizes": 5}',
    '{"scene": {}, "sizes": [0, 0, 0, 0]}',
    '{"scene": {}, "sizes": [-1, 0, 0, 0, 0]}',
    '{"scene": {}, "sizes": [0.5, 0, 0, 0, 0]}',
    f'{{"scene": {{}}, "sizes": [{2**62}, 0, 0, 0, 0]}}',
    f'{{"scene": {{}}, "sizes": [{2**70}, 0, 0, 0, 0]}}',
    '{"scene": {"gaussian_count": "many"}, "sizes": [0, 0, 0, 0, 0]}',
]


@pytest.mark.parametrize("answer", ANSWERS, ids=range(len(ANSWERS)))
def test_a_gateway_that_talks_nonsense_is_told_from_one(domain: Domain, answer: str) -> None:
    with gateway_that_says(answer.encode() + b"\n") as address:
        asks: list[Callable[[Remote], object]] = [lambda r: r.send(Pause()), lambda r: r.hello(), lambda r: r.scene()]
        for ask in asks:
            with Remote(*address, token="0" * 32) as gateway:
                try:
                    ask(gateway)
                except CosplatError as error:
                    assert isinstance(error, Malformed | Unanswered) or "error" in answer
        with pytest.raises(CosplatError):
            remote.connect(*address, token="0" * 32, domain=domain)


@pytest.mark.parametrize("line", [DEEP, "5", '{"id": [], "point": {}, "metrics": {}}', '{"id": "1", "point": 5, "metrics": {}}'])
def test_a_table_that_is_none_is_called_one(tmp_path: Path, line: str) -> None:
    table = tmp_path / "table.jsonl"
    table.write_text(line + "\n")
    with pytest.raises(SweepFailed, match="line 1 of .* is no row of a sweep"):
        sweep(SCENE, [{}], duration=0.1, table=table)


def test_a_scene_file_may_be_anything(session: LaunchedSession) -> None:
    from cosplat.scene import _collider_names

    for source in ("a = " + DEEP, "colliders = 5", "colliders = ['a']", "colliders = {a = 1}", "\0", "[[colliders]]"):
        assert _collider_names(source) == []
