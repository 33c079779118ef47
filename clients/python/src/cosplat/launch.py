"""A server of one's own, started and stopped with a session."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Literal

from .domain import Domain
from .errors import CosplatError, LaunchFailed, NoServer, OtherTransport, TimedOut
from .orders import Stop
from .session import Session
from .timeouts import seconds

_numbers = itertools.count(1)


class LaunchedSession(Session):
    """A session with the server that serves it, made by `launch`; `close` ends both."""

    def __init__(
        self, name: str, domain: Domain, process: subprocess.Popen[bytes], words: IO[bytes], lock: Path | None
    ) -> None:
        """`lock` is the file to be removed when the server has ended."""
        super().__init__(name, 0.05, domain)
        self._patience = 10.0
        self.process = process
        """The server."""
        self._words = words
        self._lock_file = lock
        self._launcher = os.getpid()

    def close(self) -> None:
        """Stops the server and leaves the session; a forked child only forgets it. What is held stays as it is."""
        is_ours = os.getpid() == self._launcher
        if is_ours and self.process.poll() is None:
            with contextlib.suppress(CosplatError, ValueError):
                self.send(Stop(), timeout=1.0)
        super().close()
        if is_ours:
            _end(self.process, self._lock_file)
            self._words.close()


def launch(
    scene: str | os.PathLike[str],
    *,
    session: str | None = None,
    pace: Literal["realtime", "free", "lockstep"] = "realtime",
    participants: Sequence[str] = (),
    paused: bool = False,
    threads: int = 0,
    parameters: Mapping[str, Any] | None = None,
    arguments: Sequence[str] = (),
    program: str | os.PathLike[str] | None = None,
    timeout: float = 60.0,
    domain: Domain | None = None,
) -> LaunchedSession:
    """Starts `cosplat serve` on a scene and attaches; leaving the context, or `close`, stops it.

    `scene` is a path, or the text of a scene file where it holds a line break. `session` is a name that nobody else uses
    without. With `participants` the pace is lock-step, and the first step waits for them. `parameters` are values of the file
    that are replaced or added, by the keys of `cosplat serve --set`. `arguments` are further ones of `cosplat serve`.
    `program` is the command, by default the one that COSPLAT names, or `cosplat` on the path. `timeout` [s] is for loading
    the scene. Launched by the main thread, the server ends with this process, however it ends.

    Raises LaunchFailed with the server's words when it does not start.
    """
    timeout = seconds(timeout)
    domain = domain or Domain.from_env()
    name = session or f"python-{os.getpid()}-{next(_numbers)}"
    # Whoever chooses a name may use it again, and its lock keeps the epoch, which has to grow.
    lock = None if session else domain.root / f"session-{name}.lock"
    _tidy(domain)
    with contextlib.ExitStack() as stack:
        if "\n" in str(scene):
            file = stack.enter_context(tempfile.NamedTemporaryFile("w", suffix=".toml"))
            file.write(str(scene))
            file.flush()
            scene = file.name
        # A pipe that nobody reads would stop the server when it is full.
        words = tempfile.TemporaryFile()
        command = [program_path(program), "serve", os.fspath(scene), "--session", name]
        command += ["--participants", ",".join(participants)] if participants else []
        command += ["--pace", "lockstep" if participants else pace]
        command += ["--threads", str(threads), *(["--paused"] if paused else [])]
        command += [*settings(parameters or {}), *arguments]
        environment = {**os.environ, "COSPLAT_DOMAIN": str(domain.root)}
        try:
            process = start_process(command, words, words, environment)
        except OSError as error:
            raise LaunchFailed(f"cannot start {command[0]}: {error}") from None
        try:
            return _attach(process, words, name, domain, lock, timeout)
        except BaseException:
            _end(process, lock)
            words.close()
            raise


def settings(parameters: Mapping[str, Any]) -> list[str]:
    """Arguments of commands that replace or add values of a scene file."""
    return [word for key, value in parameters.items() for word in ("--set", f"{key}={_toml(value)}")]


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(key)} = {_toml(entry)}" for key, entry in value.items()) + "}"
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return json.dumps(value)


def program_path(program: str | os.PathLike[str] | None) -> str:
    """The command `cosplat`: as named, as COSPLAT names it, or on the path. Raises LaunchFailed when there is none."""
    named = program or os.environ.get("COSPLAT") or shutil.which("cosplat")
    if not named:
        raise LaunchFailed("no command `cosplat` on the path: `cargo install --path .`, or name it by COSPLAT or `program`")
    return os.fspath(named)


def start_process(
    command: Sequence[str], output: IO[bytes], words: IO[bytes], environment: Mapping[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """Starts a process that ends with this one, however it ends, where the main thread starts it. Raises OSError."""
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=words,
        env=environment,
        preexec_fn=_end_with_parent if threading.current_thread() is threading.main_thread() else None,
    )


def _attach(
    process: subprocess.Popen[bytes], words: IO[bytes], name: str, domain: Domain, lock: Path | None, timeout: float
) -> LaunchedSession:
    deadline = time.monotonic() + timeout
    while True:
        try:
            return LaunchedSession(name, domain, process, words, lock)
        except (NoServer, TimedOut, OtherTransport):
            if process.poll() is not None:
                words.seek(0)
                text = words.read().decode(errors="replace").strip()
                raise LaunchFailed(f"the server ended with status {process.returncode}: {text}") from None
            if time.monotonic() >= deadline:
                raise LaunchFailed(f"the server did not serve within {timeout:.0f} s") from None


def _end(process: subprocess.Popen[bytes], lock: Path | None) -> None:
    for ask in (process.poll, process.terminate, process.kill):
        ask()
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(5.0)
            break
    if lock is not None:
        _remove(lock)


def _tidy(domain: Domain) -> None:
    """Removes the locks that launchers left which were killed."""
    for lock in domain.root.glob("session-python-*.lock"):
        made_up = re.fullmatch(r"session-python-(\d+)-\d+\.lock", lock.name)
        if made_up is not None and not Path(f"/proc/{made_up[1]}").exists():
            _remove(lock)


def _remove(lock: Path) -> None:
    """Removes the lock of a session that nobody serves."""
    with contextlib.suppress(OSError), lock.open("r+b") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.unlink()


def _end_with_parent() -> None:
    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGTERM)
