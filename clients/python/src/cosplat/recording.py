"""Recordings read back: frames of any step, objects, journal, hashes. Needs the extra `recording`."""

from __future__ import annotations

import errno
import json
import os
import stat
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import wire
from .assembly import Assembly
from .errors import BadName, CosplatError, Malformed, RecordingDamaged
from .scene import Scene
from .streams import Frame, Objects
from .wire import AppliedCommand, Command, FrameHeader, GaussianRest, GaussianState, MaterialSpec, ObjectInfo
from .wire import ObjectsHeader, ObjectState, SceneHeader

_POINT_FIELDS = (
    *("x", "y", "z", "red", "green", "blue", "alpha"),
    *("cov_xx", "cov_xy", "cov_xz", "cov_yy", "cov_yz", "cov_zz"),
    *("object_id", "index", "rot_x", "rot_y", "rot_z", "rot_w"),
)
_OBJECT = "/gaussians/"
_PACKED = "cosplat.packed"
_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5
_LONGEST_VARINT = 10

T = TypeVar("T")


class Recording:
    """One run in a file of `cosplat record`; use it as a context manager, or call `close`.

    What it gives is in memory of its own. `docs/recording-format.md` says what is in a file.
    """

    def __init__(self, path: str | os.PathLike[str], run: int = -1) -> None:
        """Opens the run number `run` of a file: -1 for the last one; a file has several when its server was started anew.

        Raises OSError when it cannot be read, RecordingDamaged when it is no recording, or one that nobody finished, and
        BadName when it has no such run.
        """
        try:
            import mcap.reader
        except ImportError:
            raise CosplatError("recordings need the package mcap: pip install 'cosplat[recording]'") from None
        self.path = Path(path)
        """The file."""
        # Of a pipe, opening waits for a writer.
        if not stat.S_ISREG(self.path.stat().st_mode):
            raise RecordingDamaged(f"{self.path} is no recording: it is no regular file")
        self._file = self.path.open("rb")
        try:
            self._reader: Any = self._guarded(lambda: mcap.reader.SeekingReader(self._file, validate_crcs=True))
            summary = self._guarded(self._reader.get_summary)
            if summary is None or not summary.chunk_indexes and summary.statistics is None:
                raise RecordingDamaged(f"{self.path} has no index: `cosplat recover {self.path}` makes one")
            self._guarded(self._check_sizes)
            records = [r.metadata for r in self._guarded(lambda: list(self._reader.iter_metadata())) if r.name == "cosplat.run"]
            epochs = self._guarded(lambda: [int(record["epoch"], 16) for record in records])
            self.run_count = len(records)
            """Runs in the file."""
            if not -self.run_count <= run < self.run_count:
                raise BadName(f"{self.path} has {self.run_count} runs, asked for number {run}")
            self.metadata: dict[str, str] = dict(records[run])
            """What the file says about the run; see the recording format."""
            self.epoch = epochs[run]
            """Identifies the run."""
            self._records = records[: run % self.run_count + 1]
            self._guarded(self._read_status)
        except BaseException:
            self._file.close()
            raise

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.steps)

    def frame(self, step: int) -> Frame:
        """The frame of a step, as it was published. Raises BadName when the step is not in the recording."""
        time = self._time_of(step)
        if step in self._since:
            for frame in self._assembled(self._whole_before(step), time):
                if frame.step == step:
                    return frame
        else:
            for _, _, data in self._messages(["/gaussians"], step, time):
                return self._frame(step, data)
        raise RecordingDamaged(f"{self.path}: the Gaussians of step {step} are missing")

    def frames(self) -> Iterator[Frame]:
        """All frames, in the order of the file."""
        if self._since:
            yield from self._assembled(*self._span)
        for _, sequence, data in self._messages(["/gaussians"]):
            step = self._low_steps.get(sequence)
            if step is not None:
                yield self._frame(step, data)

    def objects(self, step: int) -> Objects:
        """The objects after a step. Raises BadName when the step is not in the recording."""
        known: dict[int, Any] = {}

        def read(record: dict[str, Any]) -> Objects | None:
            if int(record["epoch"], 16) != self.epoch:
                return None
            # Those that are as they were are not told again.
            known.update((entry["id"], entry) for entry in record["objects"])
            count = record.get("count") or len(record["objects"])
            if record["step"] != step or len(known) != count:
                return None
            states = np.array([_values(ObjectState, known[id]) for id in sorted(known)], ObjectState.dtype)
            # Older recordings have no hash here.
            values = {**record, "state_hash": record.get("state_hash") or "0", "count": len(states)}
            return Objects(ObjectsHeader(*_values(ObjectsHeader, values)), states, 0, False, (self.names, []))

        for objects in self._records_of("/objects", read, self._whole_before(step), self._time_of(step)):
            if objects is not None:
                return objects
        raise RecordingDamaged(f"{self.path}: the objects of step {step} are missing")

    def journal(self) -> list[AppliedCommand]:
        """The commands of the run, in the order in which they took effect."""

        def read(record: dict[str, Any]) -> AppliedCommand:
            material = MaterialSpec(*_values(MaterialSpec, record["material"]))
            command = Command(*_values(Command, {**record, "material": material}))
            return AppliedCommand(*_values(AppliedCommand, {**record, "command": command}))

        return list(self._records_of("/journal", read, *self._span))

    def gaps(self) -> list[dict[str, Any]]:
        """Steps of the run that are not in the recording: `from_step`, `to_step`, `reason`."""

        def read(record: dict[str, Any]) -> tuple[int, dict[str, Any]]:
            return int(record["epoch"], 16), record

        return [record for epoch, record in self._records_of("/gaps", read) if epoch == self.epoch]

    def scene(self) -> Scene:
        """The scene of the run. Raises RecordingDamaged when the file does not hold it."""
        return self._guarded(self._read_scene, "the scene")

    def _read_scene(self) -> Scene:
        # Attachments follow the record of the first run that has their scene.
        count = sum(record.get("scene_attached") == "true" for record in self._records)

        def block(name: str, kind: np.dtype[Any]) -> NDArray[Any]:
            return np.frombuffer(self.attachment(name, count - 1), kind)

        values = {name: self._meta(name) for name in SceneHeader.dtype.names or ()}
        header = SceneHeader(**values)
        gaussians = block("scene/gaussians.bin", GaussianRest.dtype)
        sh = block("scene/sh.bin", np.dtype("<f4"))
        features: NDArray[np.float32] = np.empty(0, np.float32)
        if header.feature_dim:
            features = block("scene/features.bin", np.dtype("<f4"))
        objects = block("scene/objects.bin", ObjectInfo.dtype)
        source = self.attachment("scene.toml", count - 1).decode(errors="replace")
        return Scene(header, gaussians, sh, objects, features, source)

    def attachment(self, name: str, number: int = -1) -> bytes:
        """A file inside the file; of several with that name the one of this number. Raises BadName."""
        found = [a for a in self._guarded(lambda: list(self._reader.iter_attachments())) if a.name == name]
        if not -len(found) <= number < len(found):
            raise BadName(f"{self.path} has {len(found)} attachments named {name!r}, asked for number {number}")
        data: bytes = found[number].data
        return data

    @property
    def names(self) -> list[str]:
        """Names of the objects, by id. Raises RecordingDamaged."""
        return self._guarded(
            lambda: [self.metadata[f"object.{number}.name"] for number in range(int(self.metadata["object_count"]))], "names"
        )

    def _read_status(self) -> None:
        """Reads the headers of all frames."""
        self._headers: dict[int, FrameHeader] = {}
        self._times: dict[int, int] = {}
        self._since: dict[int, int] = {}
        """Steps whose frames are told by what changed, and the steps that they build on; their own where they are whole."""
        self._wholes: dict[int, int] = {}
        """Times of the newest whole frame at such a step."""
        whole = int(self.metadata.get("log_time_ns", 0))
        for _, _, message in self._reader.iter_messages(["/status"], log_time_order=False):
            record = json.loads(message.data)
            if int(record["epoch"], 16) == self.epoch:
                header = FrameHeader(*_values(FrameHeader, record))
                self._headers[header.step] = header
                self._times[header.step] = message.log_time
                since = _since(record)
                if since is None:
                    whole = message.log_time
                else:
                    self._since[header.step] = since
                    whole = message.log_time if since == header.step else whole
                self._wholes[header.step] = whole
        self._low_steps = {step % 2**32: step for step in self._headers}
        times = self._times.values()
        self._span = (int(self.metadata.get("log_time_ns", 0)), max(times, default=0))
        self.steps: NDArray[np.uint64] = np.array(list(self._headers), np.uint64)
        """Steps of the frames, in the order of the file."""
        self.hashes: NDArray[np.uint64] = np.array([h.state_hash for h in self._headers.values()], np.uint64)
        """Hashes of the state after these steps."""
        self.sim_times: NDArray[np.float64] = np.array([h.sim_time for h in self._headers.values()])
        """Simulated times at the ends of these steps [s]."""

    def _time_of(self, step: int) -> int:
        if step not in self._times:
            held = f"{self.steps.min()} to {self.steps.max()}" if len(self) else "none"
            raise BadName(f"step {step} is not in {self.path}, whose run has {held}")
        return self._times[step]

    def _whole_before(self, step: int) -> int:
        """Time of the whole frame that a step's builds on [ns]."""
        self._time_of(step)
        return self._wholes[step]

    def _assembled(self, start: int, end: int) -> Iterator[Frame]:
        """The frames between two times that are told by what changed; the first has to be whole."""
        topics = {channel.topic for channel in self._guarded(self._reader.get_summary).channels.values()}
        wanted = ["/status", "/places", *(topic for topic in topics if topic.startswith(_OBJECT))]
        assembly, last = Assembly(), -1
        header: FrameHeader | None = None

        def take(topic: str, sequence: int, data: bytes) -> Frame | None:
            nonlocal header, last
            if topic == "/status":
                record = json.loads(data)
                header, since = FrameHeader(*_values(FrameHeader, record)), _since(record)
                is_ours = int(record["epoch"], 16) == self.epoch
                if since == header.step:
                    if header.count * GaussianState.dtype.itemsize > self._limit:
                        raise Malformed(f"{header.count} Gaussians are more than a file of this size can tell")
                    assembly.begin(header.count)
                elif not is_ours or since != last:
                    header = None
                header = header if is_ours else None
                last = -1
            elif header is None or header.step % 2**32 != sequence:
                pass
            elif topic == "/places":
                for object, position, rotation in _places(data):
                    assembly.place(object, position, rotation)
                last = header.step
                return Frame(header, assembly.gaussians.copy(), 0, False, ([], []))
            else:
                gaussians, frame = _point_cloud(data)
                first = int(gaussians["index"][0])
                if frame == "world":
                    assembly.put(first, gaussians)
                else:
                    assembly.keep(int(topic.removeprefix(_OBJECT)), first, gaussians)
            return None

        for topic, sequence, data in self._messages(wanted, None, start, end):
            found = self._guarded(lambda: take(topic, sequence, data), f"{topic} {sequence}")
            if found is not None:
                yield found

    def _messages(
        self, topics: list[str], step: int | None = None, start: int | None = None, end: int | None = None
    ) -> Iterator[tuple[str, int, bytes]]:
        """Topics, sequence numbers and bytes; of one `step` at the time `start`, or between two times."""
        if start is not None and end is None:
            end = start
        if start is not None and any(topic.startswith("/gaussians") for topic in topics):
            start = self._readable_from(start)
        span = {} if start is None else {"starting_at": start, "ending_at": end}
        clouds: dict[int, NDArray[np.uint8]] = {}
        messages = self._reader.iter_messages(topics, log_time_order=False, **span)
        while (found := self._guarded(lambda: next(messages, None))) is not None:
            _, channel, message = found
            data = message.data
            if channel.message_encoding == _PACKED:
                what = f"{channel.topic} {message.sequence}"
                data = self._guarded(lambda: _unpacked(message.data, channel.id, clouds), what)
            if step is None or message.sequence == step % 2**32:
                yield channel.topic, message.sequence, data

    def _readable_from(self, time: int) -> int:
        """Where reading begins for what is there at a time: packed messages build on those before in their chunk."""
        summary = self._guarded(self._reader.get_summary)
        if all(channel.message_encoding != _PACKED for channel in summary.channels.values()):
            return time
        chunks = (c for c in summary.chunk_indexes if c.message_start_time <= time <= c.message_end_time)
        return min((chunk.message_start_time for chunk in chunks), default=time)

    def _records_of(
        self, topic: str, read: Callable[[dict[str, Any]], T], start: int | None = None, end: int | None = None
    ) -> Iterator[T]:
        """What `read` makes of the JSON of each message of a topic."""
        for _, sequence, data in self._messages([topic], None, start, end):
            yield self._guarded(lambda: read(json.loads(data)), f"{topic} {sequence}")

    def _frame(self, step: int, data: bytes) -> Frame:
        gaussians, _ = self._guarded(lambda: _point_cloud(data), f"/gaussians of step {step}")
        header = self._headers[step]
        if len(gaussians) != header.count:
            raise RecordingDamaged(
                f"{self.path}: step {step} has {len(gaussians)} Gaussians, its /status says {header.count}"
            )
        return Frame(header, gaussians, 0, False, ([], []))

    def _meta(self, name: str) -> Any:
        """A field of the scene's header in the words of the metadata."""
        text = self.metadata[name]
        # Hashes are hexadecimal, as in the messages.
        return _value(SceneHeader.dtype[name], text if name in ("epoch", "scene_hash") else json.loads(text))

    def _check_sizes(self) -> None:
        """Looks at what every chunk unpacks to. Raises Malformed for more than a file of this size may hold."""
        size = os.fstat(self._file.fileno()).st_size
        self._limit = _ALWAYS + _PER_BYTE * size
        summary = self._reader.get_summary()
        for chunk in summary.chunk_indexes:
            self._file.seek(chunk.chunk_start_offset)
            told, held = _unpacked_size(self._file.read(_CHUNK_HEAD))
            if max(told, held) > self._limit:
                raise Malformed(f"a chunk unpacks to {max(told, held)} bytes, expected at most {self._limit}")

    def _guarded(self, read: Callable[[], T], what: str = "") -> T:
        """Runs what reads the file. Whatever it raises is damage, but for errors of the system that reads the file for it."""
        if self._file.closed:
            raise ValueError(f"the recording {self.path} is closed")
        try:
            return read()
        except RecordingDamaged:
            raise
        except Exception as error:
            # Places that no file has are not valid arguments.
            if isinstance(error, OSError) and error.errno != errno.EINVAL:
                raise
            where = f"{self.path}: {what}" if what else f"{self.path} is damaged or no recording"
            raise RecordingDamaged(f"{where}: {error!r:.300}") from error


# What an input may make its reader hold, as in docs/faults.md [byte].
_ALWAYS = 64 << 20
_PER_BYTE = 1024
# A chunk's record up to the header of its first compressed frame.
_CHUNK_HEAD = 64


def _unpacked_size(chunk: bytes) -> tuple[int, int]:
    """How many bytes a chunk says that it unpacks to, and how many its compressed data says."""
    [told] = struct.unpack_from("<Q", chunk, 25)
    [length] = struct.unpack_from("<I", chunk, 37)
    if chunk[41 : 41 + length] != b"zstd":
        return told, 0
    import zstandard

    # -1 where it does not say, and then no more is unpacked than the chunk says.
    return told, zstandard.frame_content_size(chunk[41 + length + 8 :])


def _since(record: dict[str, Any]) -> int | None:
    """The step that a frame builds on; None for one that is told as a whole."""
    since = record.get("since")
    return None if since is None else int(_value(FrameHeader.dtype["step"], since))


def _values(kind: type[wire.Record], record: dict[str, Any]) -> tuple[Any, ...]:
    """The fields of a wire type from a JSON object of the same names. Raises KeyError, TypeError, ValueError."""
    return tuple(_value(kind.dtype[name], record[name]) for name in kind.dtype.names or ())


def _value(kind: np.dtype[Any], value: Any) -> Any:
    """A field of a wire type from JSON: hashes are hexadecimal, and null is what is no finite number."""
    if kind.names is not None:
        if not isinstance(value, wire.Record):
            raise TypeError(f"{value!r} is no record")
        return value
    if kind.shape:
        numbers = np.array([_value(kind.base, number) for number in value], kind.base)
        if numbers.shape != kind.shape:
            raise ValueError(f"{len(numbers)} numbers, expected {kind.shape[0]}")
        return numbers
    if kind.kind == "f":
        return float("nan") if value is None else float(value + 0.0)
    number = int(value, 16) if isinstance(value, str) else value
    if not isinstance(number, int) or not 0 <= number < 1 << (8 * kind.itemsize):
        raise ValueError(f"{value!r} is no whole number of {8 * kind.itemsize} bits")
    return number


def _point_cloud(data: bytes) -> tuple[NDArray[np.void], str]:
    """The Gaussians of a `foxglove.PointCloud` and their frame. Raises ValueError or IndexError when it is none of Gaussians."""
    stride, names, points, frame = 0, [], b"", ""
    for number, value in _protobuf(data):
        if number == 2 and isinstance(value, bytes):
            frame = value.decode()
        elif number == 4 and isinstance(value, bytes):
            stride = int.from_bytes(value, "little")
        elif number == 5 and isinstance(value, bytes):
            names.append(next(bytes(v).decode() for n, v in _protobuf(value) if n == 1 and isinstance(v, bytes)))
        elif number == 6 and isinstance(value, bytes):
            points = value
    if stride != GaussianState.dtype.itemsize or tuple(names) != _POINT_FIELDS:
        raise ValueError(f"points of stride {stride} with the fields {names} are no Gaussians")
    # A copy: arrays that nobody can write would be a surprise in a recording.
    return np.frombuffer(points, GaussianState.dtype).copy(), frame


def _unpacked(data: bytes, channel: int, clouds: dict[int, NDArray[np.uint8]]) -> bytes:
    """A message of a compacted recording as it was; `clouds` has the points of the newest of each channel."""
    if data[0] == 0:
        clouds.pop(channel, None)
        return data[1:]
    [length] = struct.unpack_from("<Q", data, 1)
    points = np.frombuffer(data, np.uint8, length, 9).reshape(GaussianState.dtype.itemsize, -1).T.copy()
    if data[0] == 2:
        if channel not in clouds or clouds[channel].shape != points.shape:
            raise ValueError("a packed message builds on one that was not read")
        points ^= clouds[channel]
    clouds[channel] = points
    key, rest = b"\x32", length
    while rest >= 0x80:
        key, rest = key + bytes([rest & 0x7F | 0x80]), rest >> 7
    return key + bytes([rest]) + points.tobytes() + data[9 + length :]


def _places(data: bytes) -> Iterator[tuple[int, list[float], list[float]]]:
    """Objects, positions and rotations of a `foxglove.FrameTransforms`. Raises ValueError or IndexError when it is none."""
    for number, transform in _protobuf(data):
        if number != 1 or not isinstance(transform, bytes):
            continue
        # Protobuf leaves out what is zero.
        child, position, rotation = "", [0.0] * 3, [0.0] * 4
        for field, value in _protobuf(transform):
            if not isinstance(value, bytes):
                continue
            if field == 3:
                child = value.decode()
            numbers = {4: position, 5: rotation}.get(field)
            if numbers is not None:
                for n, bits in _protobuf(value):
                    numbers[n - 1] = struct.unpack("<d", bytes(bits))[0]
        yield int(child.removeprefix("form/")), position, rotation


def _protobuf(data: bytes) -> Iterator[tuple[int, bytes | int]]:
    """Field numbers and values of a protobuf message."""
    at = 0

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            if shift >= 7 * _LONGEST_VARINT:
                raise ValueError(f"a number of more than {_LONGEST_VARINT} bytes")
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while at < len(data):
        key = varint()
        kind = key & 7
        if kind == _VARINT:
            yield key >> 3, varint()
            continue
        length = {_FIXED64: 8, _FIXED32: 4}.get(kind)
        if length is None:
            if kind != _BYTES:
                raise ValueError(f"protobuf of kind {kind}")
            length = varint()
        if at + length > len(data):
            raise ValueError(f"a field of {length} bytes, {len(data) - at} are left")
        yield key >> 3, data[at : at + length]
        at += length
