"""A session on another machine: streams by the tunnel of iceoryx2, orders and the scene by a gateway. `docs/across-machines.md`."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import socket
import threading
from collections.abc import Iterator
from typing import Any, NoReturn, Self

import numpy as np

from .domain import Domain
from .errors import (
    BadName,
    CosplatError,
    Malformed,
    NoServer,
    Refused,
    ServerLost,
    StepRefused,
    TimedOut,
    TransportFailed,
    Unanswered,
)
from .orders import Ack, Order
from .scene import Scene
from .session import Session, check_version
from .timeouts import seconds
from .transport import Belonging
from .wire import GaussianRest, Hello, ObjectInfo, SceneHeader

_RAISED = {
    kind.__name__: kind for kind in (BadName, Malformed, NoServer, ServerLost, TimedOut, TransportFailed, Unanswered)
}


def connect(address: str, port: int, *, timeout: float = 30.0, domain: Domain | None = None) -> RemoteSession:
    """Attaches to the session of a gateway, whose streams a tunnel brings to this machine's `domain`.

    Waits up to `timeout` [s] for the gateway, for the tunnel, and for every answer. Raises NoServer, OtherVersion, and TimedOut
    when the streams do not come.
    """
    return RemoteSession(address, port, timeout, domain or Domain.from_env())


class Remote:
    """Sends orders by a gateway on another machine, with the answers and exceptions of `Session.send`."""

    def __init__(self, address: str, port: int, timeout: float = 10.0) -> None:
        """Connects, waiting up to `timeout` [s] for this and for every answer. Raises NoServer."""
        # For a socket 0 is another mode, and None as long as it takes.
        wait = max(1e-3, seconds(timeout))
        try:
            self._socket = socket.create_connection((address, port), wait if wait < threading.TIMEOUT_MAX else None)
        except OSError as error:
            raise NoServer(f"no gateway at {address}:{port}: {error}") from None
        self._answers = self._socket.makefile("rb")
        # Threads ask one after the other.
        self._lock = Belonging(threading.RLock())

    def send(self, *orders: Order) -> list[Ack]:
        """Sends 1 to 32 orders and waits for their answers.

        Raises Refused when one is refused, BadName for names that the scene or the gateway does not have, Malformed for
        what is no order, Unanswered when no answer comes, and what the gateway itself meets.
        """
        if not orders:
            return []
        entries = [{"order": type(order).__name__, **_fields(order)} for order in orders]
        with _understood():
            acks = [Ack(*ack) for ack in self._ask({"orders": entries})["acks"]]
        if not all(ack.accepted for ack in acks):
            raise Refused(acks)
        return acks

    def hello(self) -> tuple[str, Hello]:
        """The name of the session, and the greeting of its server."""
        with _understood():
            answer = self._ask({"ask": "hello"})
            fields = {**answer["hello"], "server_version": answer["hello"]["server_version"].encode()}
            return str(answer["session"]), Hello(**fields)

    def scene(self) -> Scene:
        """The scene of the server's present run; the connection is used up by it."""
        with _understood():
            answer = self._ask({"ask": "scene"})
            [header] = np.zeros(1, SceneHeader.dtype)
            for name, value in answer["scene"].items():
                header[name] = value
            try:
                blocks = [self._answers.read(size) for size in answer["sizes"]]
            except OSError as error:
                raise Unanswered(f"the scene did not come: {error}") from None
            gaussians, sh, objects, features, source = blocks
            if [len(block) for block in blocks] != answer["sizes"]:
                raise Unanswered("the gateway hung up in the middle of the scene")
            return Scene(
                SceneHeader.read(header),
                np.frombuffer(gaussians, GaussianRest.dtype),
                np.frombuffer(sh, "<f4"),
                np.frombuffer(objects, ObjectInfo.dtype),
                np.frombuffer(features, "<f4"),
                source.decode(errors="replace"),
            )

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        text = json.dumps(request, default=lambda value: value.tolist())
        try:
            with self._lock.native:
                self._socket.sendall(text.encode() + b"\n")
                line = self._answers.readline()
        except OSError as error:
            raise Unanswered(f"no answer from the gateway: {error}") from None
        if not line.endswith(b"\n"):
            raise Unanswered("the gateway hung up: orders that the server has looked at take effect")
        answer: dict[str, Any] = json.loads(line)
        if "error" in answer:
            raise _RAISED.get(answer["error"]["kind"], CosplatError)(answer["error"]["words"])
        return answer

    def close(self) -> None:
        """Hangs up."""
        self._answers.close()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RemoteSession(Session):
    """A session on another machine; made by `connect`. Lock-step is not carried.

    Who publishes under the session's name in this domain is believed: the tunnel's messages do not say who sent them.
    """

    def __init__(self, address: str, port: int, timeout: float, domain: Domain) -> None:
        self._gateway = address, port, timeout
        self._remote = Remote(*self._gateway)
        name, hello = self._remote.hello()
        super().__init__(name, timeout, domain, "remote", greeting=_RemoteGreeting(self._remote, hello))

    def send(self, *orders: Order, timeout: float = 5.0) -> list[Ack]:
        """Sends orders by the gateway, as `Remote.send` does; the gateway's own `timeout` holds."""
        return self._remote.send(*orders)

    def serves(self, node: int) -> bool:
        """True: see above."""
        return True

    def participate(self, name: str = "python") -> NoReturn:
        """Raises StepRefused."""
        raise StepRefused("lock-step is not carried to other machines: a participant runs beside the server")

    def read_scene(self, epoch: int, timeout: float) -> Scene:
        """The scene from the gateway: the tunnel forwards what is sent while it is there, and scenes are sent once."""
        with Remote(*self._gateway) as remote:
            return remote.scene()

    def close(self) -> None:
        """Leaves the session. Frames and scenes that are held stay as they are."""
        self._remote.close()
        super().close()


class _RemoteGreeting:
    """What the gateway knows of the server."""

    def __init__(self, remote: Remote, hello: Hello) -> None:
        check_version("of the gateway", hello)
        self._remote, self.hello = remote, hello
        self.server = 0

    def look(self) -> bool:
        _, found = self._remote.hello()
        is_new = found.epoch != self.hello.epoch
        self.hello = found
        return is_new


@contextlib.contextmanager
def _understood() -> Iterator[None]:
    try:
        yield
    except (KeyError, TypeError, ValueError, IndexError) as error:
        if isinstance(error, CosplatError):
            raise
        raise Malformed(f"the gateway's answer is none: {error!r}") from None


def _fields(order: Order) -> dict[str, Any]:
    return {field.name: getattr(order, field.name) for field in dataclasses.fields(order)}
