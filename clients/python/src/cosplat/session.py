"""A session: attach to a server, read its streams, send it orders."""

from __future__ import annotations

import logging
import math
import os
import re
import secrets
import threading
import time
import weakref
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol, Self

from . import scene, transport, wire
from .domain import ICEORYX2_VERSION, Domain
from .errors import (
    BadName,
    Malformed,
    NoServer,
    OtherTransport,
    OtherVersion,
    Refused,
    TimedOut,
)
from .lockstep import Participant
from .orders import Ack, Order
from .packing import packer
from .requests import RETRY_PERIOD, RequestPort
from .scene import Scene
from .streams import ChangesReader, Contacts, Frame, Journal, Names, Objects, Reader, lost
from .timeouts import seconds
from .wire import AppliedCommand, CommandHeader, FrameHeader, GaussianState, Hello, JournalHeader
from .wire import ObjectsHeader, ObjectState, Status

# The longest pause between two signs of life is a tenth of it.
SILENCE = 1.0
# A server whose process lives may be stopped, or kept from its processor.
LONG_SILENCE = 10.0

_HEAD = packer(CommandHeader)

_log = logging.getLogger("cosplat")


def connect(
    session: str = "default",
    *,
    timeout: float = 10.0,
    domain: Domain | None = None,
    role: str = "python",
    client: int | None = None,
) -> Session:
    """Attaches to a session, waiting up to `timeout` [s] for its server.

    Timeouts of this package are numbers: what is below 0 counts as 0, and infinity is as long as it takes. Others, NaN too, raise
    TypeError or ValueError.

    `domain` is that of COSPLAT_DOMAIN without. `role`, a few plain characters, names the process in listings. `client`, below
    2**64, orders this process's orders among those of others for the same step; a random number without. Use it as a context
    manager, or call `close`.

    Raises NoServer, OtherVersion, OtherTransport, BadName, DomainUnusable, TimedOut.
    """
    return Session(session, timeout, domain or Domain.from_env(), role, client)


def _greet(session: str, timeout: float, domain: Domain, node: Any) -> _Greeting:
    """The server's greeting, of a version that this package knows."""
    deadline = time.monotonic() + timeout
    while True:
        try:
            greeting = _Greeting(node, domain, session)
            break
        except (NoServer, TimedOut, OtherTransport):
            if time.monotonic() >= deadline:
                raise
        time.sleep(RETRY_PERIOD)
    check_version(session, greeting.hello)
    return greeting


def check_version(session: str, hello: Hello) -> None:
    """Raises OtherVersion for a server that this package does not know."""
    release = hello.server_version.decode(errors="replace")
    if hello.wire_version != wire.WIRE_VERSION:
        raise OtherVersion(
            f"session {session!r} is served by cosplat {release} (process {hello.pid}) with wire version "
            f"{hello.wire_version}, this package has {wire.WIRE_VERSION}: use the same release on both sides"
        )
    if hello.schema_hash != wire.SCHEMA_HASH:
        raise OtherVersion(
            f"session {session!r} is served by process {hello.pid} with layout hash {hello.schema_hash:016x}, this "
            f"package has {wire.SCHEMA_HASH:016x}: install it from the source that the server was built from"
        )


class Greeting(Protocol):
    """Who serves."""

    hello: Hello
    """The newest greeting."""
    server: int
    """The node that published it."""

    def look(self) -> bool:
        """Whether a server greeted since the last look."""


class _Greeting:
    """Who serves: the one publisher of `hello`."""

    def __init__(self, node: Any, domain: Domain, session: str) -> None:
        try:
            self._service = transport.single(node, f"cosplat/{session}/hello", Hello)
        except transport.Absent:
            raise NoServer(_no_server(session, domain)) from None
        except transport.Corrupted:
            releases = ", ".join(domain.other_transports()) or "an unknown one"
            raise OtherTransport(
                f"session {session!r} exists but cannot be read: this program uses iceoryx2 {ICEORYX2_VERSION}, in "
                f"{domain.root} there are traces of {releases}; use the same release on both sides"
            ) from None
        self._port = transport.subscriber(self._service, 1, 1)
        self._lock = transport.Belonging(threading.RLock())
        self.hello: Hello
        self.server = 0
        deadline = time.monotonic() + 0.5
        while not self.look():
            if self._service.dynamic_config.number_of_publishers == 0:
                raise NoServer(_no_server(session, domain))
            if time.monotonic() >= deadline:
                raise TimedOut(f"session {session!r} is served, but its greeting did not come within 0.5 s")
            time.sleep(RETRY_PERIOD)
        is_ours = (self.hello.wire_version, self.hello.schema_hash) == (wire.WIRE_VERSION, wire.SCHEMA_HASH)
        if is_ours:
            # The last service that a server makes: when it is there, all are.
            try:
                transport.event(node, f"cosplat/{session}/v{wire.WIRE_VERSION}/command")
            except transport.Absent:
                raise TimedOut(f"session {session!r} is served, but its services did not come in time") from None

    def look(self) -> bool:
        """Whether a server greeted since the last look."""
        with self._lock.native:
            sample = transport.receive(self._port, "hello", 1)
            if sample is None:
                return False
            self.hello = transport.fixed(sample, Hello)
            self.server = sample.header.node_id.value
            return True


def _no_server(session: str, domain: Domain) -> str:
    served = domain.sessions()
    others = ", ".join(f"{name!r} (process {pid})" for name, pid in sorted(served.items()))
    return (
        f"no server for session {session!r} in {domain.root}: start one with `cosplat serve SCENE.toml --session {session}`; "
        + (f"served there: {others}" if others else "no session is served there")
    )


class Session:
    """An attached process; made by `connect`. Messages that are held outlive it.

    The threads of a process may share it. A process that is forked from it attaches by itself: what it inherited raises OtherProcess.
    """

    def __init__(
        self,
        name: str,
        timeout: float,
        domain: Domain,
        role: str = "python",
        client: int | None = None,
        greeting: Greeting | None = None,
    ) -> None:
        if not re.fullmatch(r"[A-Za-z0-9._-]{1,64}", name):
            raise BadName(f"{name!r} is not a session name: expected 1 to 64 of the characters a-z A-Z 0-9 - _ .")
        timeout = seconds(timeout)
        self.name = name
        """Name of the session."""
        self.domain = domain
        """The domain attached to."""
        self._node: transport.Belonging | None = transport.Belonging(domain.join(role))
        self._lock = transport.Belonging(threading.RLock())
        self._greeting: Greeting = greeting or _greet(name, timeout, domain, self._node)
        self._patience = max(timeout, SILENCE)
        self._ignored: set[int] = set()
        self._scene: Scene | None = None
        self._status: _StatusReader | None = None
        self._sender: RequestPort | None = None
        self.client = secrets.randbits(64) if client is None else client
        """Number of this sender in the journal."""
        self._readers: weakref.WeakSet[Reader[Any]] = weakref.WeakSet()

    @property
    def hello(self) -> Hello:
        """The server that greeted last."""
        self._greeting.look()
        return self._greeting.hello

    def frames(self, depth: int = 1) -> Reader[Frame]:
        """Reads frames: `depth` 1 for always the newest, up to 64 for a queue that loses none."""
        return self._reader("frame", Frame, GaussianState, FrameHeader, depth)

    def changes(self, depth: int = 64) -> ChangesReader:
        """Reads what moved in each step, from a complete message on, up to `depth` of them in a queue; `Assembly` makes whole
        frames of them. Nothing comes where `status().has_changes` is 0."""
        self.look_after()
        reader = ChangesReader(self, depth)
        self._readers.add(reader)
        return reader

    def objects(self, depth: int = 1) -> Reader[Objects]:
        """Reads the state of all objects: `depth` as for frames."""
        return self._reader("objects", Objects, ObjectState, ObjectsHeader, depth)

    def contacts(self, depth: int = 1) -> Reader[Contacts]:
        """Reads who touched whom during each step: `depth` as for frames."""
        return self._reader("contacts", Contacts, wire.Contact, wire.ContactsHeader, depth)

    def participate(self, name: str = "python") -> Participant:
        """Takes part in lock-step under a name: every step waits for it. Raises StepRefused for another pace."""
        return Participant(self, name)

    def journal(self) -> Reader[Journal]:
        """Reads the journal of applied commands, from the oldest that the server still keeps."""
        return self._reader("journal", Journal, AppliedCommand, JournalHeader, 256)

    def scene(self, timeout: float = 10.0) -> Scene:
        """The scene of the present run, waiting up to `timeout` [s] for it. Raises TimedOut."""
        return self._scene_of(self.hello.epoch, seconds(timeout))

    def status(self, timeout: float = 5.0) -> Status:
        """The newest status, waiting up to `timeout` [s] for the first one. Raises TimedOut."""
        timeout = seconds(timeout)
        deadline = time.monotonic() + timeout
        while (status := self._newest_status()[0]) is None:
            if time.monotonic() >= deadline:
                raise TimedOut(f"session {self.name!r} is served, but its status did not come within {timeout:.1f} s")
            time.sleep(RETRY_PERIOD)
        return status

    def send(self, *orders: Order, timeout: float = 5.0) -> list[Ack]:
        """Sends 1 to 32 orders, which take effect in this sequence, and waits up to `timeout` [s] for their answers.

        Raises Refused when one is refused (the others take effect), BadName for a name that the scene does not have (then
        nothing is sent), NoServer or TimedOut when nobody takes them, Unanswered when no answer comes.
        """
        timeout = seconds(timeout)
        if not orders:
            return []
        with self._lock.native:
            sender = self._sender = self._sender or RequestPort(self, "command", CommandHeader)
        sent = sender.submit(orders, _HEAD.pack(self.client, os.getpid(), len(orders)), timeout)
        # Without an end, whether the server lives is looked at meanwhile.
        _, acks = sender.answer(sent, timeout if timeout < math.inf else None)
        if not all(ack.accepted for ack in acks):
            raise Refused(acks)
        return acks

    def close(self) -> None:
        """Leaves the session. Frames and scenes that are held stay as they are."""
        for reader in list(self._readers):
            reader.close()
        self._sender = self._status = self._node = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # What readers need.

    def open(self, how: Callable[[Any, str], Any], stream: str) -> Any:
        """A service of this session. Raises TimedOut when it does not come."""
        if self._node is None:
            raise ValueError(f"the session {self.name!r} is closed")
        name = f"cosplat/{self.name}/v{wire.WIRE_VERSION}/{stream}"
        deadline = time.monotonic() + self._patience
        while True:
            try:
                return how(self._node, name)
            except (transport.Absent, transport.Corrupted) as error:
                if time.monotonic() >= deadline:
                    raise TimedOut(f"session {self.name!r} is coming or going: {error}") from None
            time.sleep(RETRY_PERIOD)

    def serves(self, node: int) -> bool:
        """Whether messages of this node are the server's."""
        greeting = self._greeting
        # Its greeting may come just after its first message; that of a stranger never.
        looks = 1 if node in self._ignored else 20
        for look in range(looks):
            if node == greeting.server:
                return True
            if look:
                time.sleep(RETRY_PERIOD)
            greeting.look()
        if node == greeting.server:
            return True
        if node not in self._ignored:
            self._ignored.add(node)
            _log.warning("session %r: ignoring a publisher that is not the server's", self.name)
        return False

    def names(self, epoch: int) -> Names:
        """Names of objects and colliders in the run `epoch`."""
        scene = self._scene_of(epoch, self._patience)
        return scene.names, scene.colliders

    def read_scene(self, epoch: int, timeout: float) -> Scene:
        """The scene of run `epoch` or of a later one. Raises TimedOut."""
        return scene.read(self, epoch, timeout)

    def look_after(self) -> None:
        """Attaches to the status: when the server dies, it cannot be opened any more."""
        self._newest_status()

    def is_over(self, epoch: int) -> bool:
        """Whether the run `epoch` has ended. Raises ServerLost when its server died."""
        status, heard = self._newest_status()
        silence = time.monotonic() - heard
        if silence < (LONG_SILENCE if status is None else SILENCE):
            return False
        if status is not None and status.server_state == wire.SERVER_STOPPING and status.epoch >= epoch:
            return True
        if status is not None and silence < LONG_SILENCE and Path(f"/proc/{status.pid}").exists():
            return False
        raise lost(self.name, silence)

    def _scene_of(self, epoch: int, timeout: float) -> Scene:
        with self._lock.native:
            if self._scene is None or self._scene.header.epoch < epoch:
                self._scene = self.read_scene(epoch, timeout)
            return self._scene

    def _newest_status(self) -> tuple[Status | None, float]:
        """The newest status, and when the server gave its last sign of life."""
        with self._lock.native:
            if self._status is None:
                self._status = _StatusReader(self)
            return self._status.newest(), self._status.heard

    def _reader(self, stream: str, kind: Any, element: Any, header: Any, depth: int) -> Reader[Any]:
        self.look_after()
        reader = Reader(self, stream, kind, (element, header), depth)
        self._readers.add(reader)
        return reader


class _StatusReader:
    """The newest status."""

    def __init__(self, session: Session) -> None:
        service = session.open(lambda node, name: transport.pub_sub(node, name, Status, None), "status")
        self._port = transport.subscriber(service, 1, 1)
        self._session = session
        self._newest: Status | None = None
        # Of this clock: a server on another machine has another one.
        self.heard = time.monotonic()

    def newest(self) -> Status | None:
        while (sample := transport.receive(self._port, "status", 2)) is not None:
            if self._session.serves(sample.header.node_id.value):
                elements = transport.array(sample, self._port, Status.dtype)
                if len(elements) != 1:
                    raise Malformed(f"a message on 'status' holds {len(elements)} elements, expected 1")
                before, self._newest = self._newest, Status.read(elements[0])
                if before is None or before.heartbeat_ns != self._newest.heartbeat_ns:
                    self.heard = time.monotonic()
        return self._newest
