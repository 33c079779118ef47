"""A scene with many values of its parameters: one simulation for each, and a table of what came out."""

from __future__ import annotations

import csv
import dataclasses
import fcntl
import hashlib
import itertools
import json
import logging
import math
import os
import select
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, Literal, Self, TypeAlias

import numpy as np

from .errors import BadName, LaunchFailed, SweepFailed
from .launch import program_path, settings, start_process

Value: TypeAlias = Any
"""A value of a scene file: a number, a truth, a text, a list or a mapping of them."""
Point: TypeAlias = Mapping[str, Value]
"""Keys of the scene file, dotted and counted from 0 (`objects.0.friction`), with their values."""
Metrics: TypeAlias = Mapping[str, Any]

_log = logging.getLogger("cosplat")


@dataclass(frozen=True)
class Report:
    """What one simulation reported, while its files are there."""

    point: Point
    """Its parameters."""
    summary: Mapping[str, Any]
    """What `cosplat simulate --json` says of the run."""
    path: Path
    """Its lines, one JSON object per frame: `docs/scene.md`, The report of cosplat simulate."""

    def frames(self) -> Iterator[dict[str, Any]]:
        """The frames, one after the other."""
        with self.path.open() as lines:
            for line in lines:
                yield json.loads(line)

    def last(self) -> dict[str, Any]:
        """The last frame."""
        frame: dict[str, Any] = {}
        for frame in self.frames():
            pass
        return frame


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    id: str
    """Hash of the scene's text, the parameters and the duration."""
    point: Point
    """Parameters."""
    metrics: Metrics
    """What was measured; empty where the simulation failed."""
    error: str | None = None
    """Why it failed, in the program's words."""


def at_the_end(report: Report) -> dict[str, Any]:
    """Metrics without others: energies, the state of every object and the probes at the end, and what the run took.

    Names are those of the report, with dots: `left.com` [m], `probes.front`, `kinetic_energy` [J], `wall_seconds`.
    """
    last = report.last()
    names = ("frames", "sim_seconds", "wall_seconds", "substeps", "rollbacks", "left_domain", "quarantined", "state_hash")
    metrics = {name: report.summary[name] for name in names}
    metrics |= {name: last[name] for name in ("kinetic_energy", "elastic_energy", "potential_energy")}
    metrics |= {f"probes.{name}": value for name, value in last["probes"].items()}
    for state in last["objects"]:
        of_object = ("mass", "com", "linear_velocity", "angular_velocity", "rotation", "kinetic_energy", "elastic_energy")
        metrics |= {f"{state['name']}.{name}": state[name] for name in of_object}
    return metrics


def sweep(
    scene: str | os.PathLike[str],
    parameters: Mapping[str, Sequence[Value]] | Sequence[Point],
    *,
    duration: float,
    table: str | os.PathLike[str],
    metrics: Callable[[Report], Metrics] = at_the_end,
    workers: int | None = None,
    threads: int = 1,
    on: Literal["processes", "ray"] = "processes",
    program: str | os.PathLike[str] | None = None,
) -> list[Row]:
    """Simulates a scene for `duration` [s] with all combinations of parameters, and returns one row for each, in order.

    `scene` is a path, or the text of a scene file where it holds a line break. `parameters` are lists of values by key, of
    which all combinations are made, or the combinations themselves. Keys and values are those of
    `cosplat simulate --set`. `metrics` makes a row's metrics of a report: numbers, texts, and lists of them.

    Each row is in `table`, a file of JSON lines, as soon as its simulation is over. The same call after a kill makes those that
    are missing. A simulation that fails is a row with an `error`. Results do not depend on `workers` (by default as many as
    the machine has processors for) or `threads` of each; with `on="ray"` they run where Ray has room (extra `ray`). A number
    that is not finite is `null` in the table. A change of `metrics` wants another table.

    Raises SweepFailed when simulations are killed, the table is in use or is none; BadName for a key that is none.
    """
    points = _points(parameters)
    source = str(scene) if "\n" in str(scene) else os.path.abspath(scene)
    text = source if "\n" in source else Path(source).read_text()
    ids = [_id(text, point, duration) for point in points]
    tasks = {key: Task(source, point, duration, threads, metrics) for key, point in zip(ids, points, strict=True)}
    killed: list[str] = []
    with _Table(Path(table)) as rows:
        missing = {key: task for key, task in tasks.items() if key not in rows.found}
        done = len(tasks) - len(missing)
        if on == "ray":
            # Ray is an extra.
            from .ray_pool import run_on_ray

            outcomes = run_on_ray(missing, program)
        else:
            at_once = workers or max(1, (os.cpu_count() or 1) // max(threads, 1))
            outcomes = _run_in_processes(missing, at_once, program_path(program))
        for key, outcome in outcomes:
            if outcome.is_killed:
                killed.append(f"{tasks[key].point}: {outcome.error}")
                continue
            rows.add(Row(key, tasks[key].point, outcome.metrics, outcome.error))
            done += 1
            _log.info("sweep: %d of %d simulations are done", done, len(tasks))
        if killed:
            raise SweepFailed(f"{len(killed)} of {len(tasks)} simulations were ended: {'; '.join(killed)}")
        return [rows.found[key] for key in ids]


def write_csv(rows: Sequence[Row], path: str | os.PathLike[str]) -> None:
    """Rows as a CSV file with a column per parameter and metric; lists have a column per entry, `left.com.0`."""
    flat = [
        dict(_flat("", {**row.point, **row.metrics, **({} if row.error is None else {"error": row.error})})) for row in rows
    ]
    columns = list(dict.fromkeys(itertools.chain.from_iterable(flat)))
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(flat)


def _flat(prefix: str, value: Any) -> Iterator[tuple[str, Any]]:
    entries = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list | tuple) else None
    if entries is None:
        yield prefix.removeprefix("."), value
        return
    for key, entry in entries:
        yield from _flat(f"{prefix}.{key}", entry)


@dataclass(frozen=True)
class Outcome:
    """What came of a simulation."""

    metrics: Metrics
    error: str | None = None
    is_killed: bool = False
    """Whether it was ended from outside, which says nothing about its parameters."""


@dataclass(frozen=True)
class Task:
    """A simulation to be made, on this machine or another one."""

    scene: str
    point: Point
    duration: float
    threads: int
    metrics: Callable[[Report], Metrics]

    def start(self, command: str, folder: Path) -> subprocess.Popen[bytes]:
        """Starts it; its files go to `folder`."""
        scene = self.scene
        if "\n" in scene:
            scene = str(folder / "scene.toml")
            Path(scene).write_text(self.scene)
        arguments = [command, "simulate", scene, "--duration", repr(self.duration), "--threads", str(self.threads)]
        arguments += ["--json", "--report", str(folder / "report.jsonl")]
        arguments += settings(self.point)
        with (folder / "summary.json").open("wb") as summary, (folder / "words").open("wb") as words:
            try:
                return start_process(arguments, summary, words)
            except OSError as error:
                raise LaunchFailed(f"cannot start {command}: {error}") from None

    def outcome(self, status: int, folder: Path) -> Outcome:
        """What came of it when its process ended with `status`."""
        # Where its files lie is no matter of the simulation.
        words = (folder / "words").read_text(errors="replace").strip().replace(f"{folder}/", "")
        if status < 0:
            return Outcome({}, f"signal {-status} {words}".strip(), True)
        if status > 0:
            return Outcome({}, words or f"status {status}")
        summary = json.loads((folder / "summary.json").read_text())
        return Outcome(_plain(self.metrics(Report(self.point, summary, folder / "report.jsonl"))))

    def run(self, command: str) -> Outcome:
        """The whole of it."""
        with Running(self, command) as running:
            return running.outcome()


class Running:
    """A simulation that runs; when the context is left it runs no more, and its files are gone."""

    def __init__(self, task: Task, command: str) -> None:
        self._task = task
        self._owner = os.getpid()
        # No TemporaryDirectory, which is removed by a forked child that ends, too.
        self._folder = Path(tempfile.mkdtemp(prefix="cosplat-sweep-"))
        try:
            self._process = task.start(command, self._folder)
            self._ended = os.pidfd_open(self._process.pid)
        except BaseException:
            shutil.rmtree(self._folder)
            raise

    def fileno(self) -> int:
        """Readable when it has ended."""
        return self._ended

    def outcome(self) -> Outcome:
        """Waits for its end, and says what came of it."""
        return self._task.outcome(self._process.wait(), self._folder)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        # A forked child that ends leaves it to its parent.
        if os.getpid() != self._owner:
            return
        self._process.kill()
        self._process.wait()
        os.close(self._ended)
        shutil.rmtree(self._folder)


def _run_in_processes(tasks: Mapping[str, Task], at_once: int, command: str) -> Iterator[tuple[str, Outcome]]:
    """Up to `at_once` simulations at a time; one thread waits for all, so that they end with this process."""
    waiting = iter(tasks.items())
    running: dict[Running, str] = {}
    try:
        while True:
            for key, task in itertools.islice(waiting, at_once - len(running)):
                running[Running(task, command)] = key
            if not running:
                return
            for ended in select.select(list(running), [], [])[0]:
                key = running.pop(ended)
                with ended:
                    outcome = ended.outcome()
                yield key, outcome
    finally:
        for left in running:
            with left:
                pass


class _Table:
    """Rows in a file of JSON lines, of which this process alone writes."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.found: dict[str, Row] = {}

    def __enter__(self) -> Self:
        self._file: IO[bytes] = self._path.open("a+b")
        try:
            self._read()
        except BaseException:
            self._file.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def _read(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SweepFailed(f"{self._path} is written by another sweep") from None
        self._file.seek(0)
        whole = 0
        for number, line in enumerate(self._file, 1):
            if not line.endswith(b"\n"):
                # Its process was killed while it wrote.
                break
            whole += len(line)
            try:
                row = Row(**json.loads(line))
                kinds = (row.id, str), (row.point, dict), (row.metrics, dict), (row.error, str | None)
                if not all(isinstance(value, kind) for value, kind in kinds):
                    raise TypeError(f"{row} has fields of other kinds")
            except (ValueError, TypeError, RecursionError) as error:
                raise SweepFailed(f"line {number} of {self._path} is no row of a sweep: {error!s:.300}") from None
            self.found[row.id] = row
        self._file.truncate(whole)

    def add(self, row: Row) -> None:
        self.found[row.id] = row
        self._file.write(json.dumps(dataclasses.asdict(row), allow_nan=False).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())


def _points(parameters: Mapping[str, Sequence[Value]] | Sequence[Point]) -> list[dict[str, Any]]:
    if isinstance(parameters, Mapping):
        combinations = itertools.product(*parameters.values())
        points = [dict(zip(parameters, values, strict=True)) for values in combinations]
    else:
        points = [dict(point) for point in parameters]
    for key in {key for point in points for key in point}:
        if not key or "=" in key:
            raise BadName(f"{key!r} is not a key of a scene file, like dx or objects.0.friction")
    # Values stay what they are on their way through a file.
    return [_plain(point) for point in points]


def _id(text: str, point: Point, duration: float) -> str:
    return hashlib.sha256(json.dumps([text, point, duration], sort_keys=True).encode()).hexdigest()[:16]


def _plain(value: Any) -> Any:
    """A value as JSON has it: numpy's numbers and arrays as Python's, null for a number that is none."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
