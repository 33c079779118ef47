"""A session on another machine: streams by the tunnel of iceoryx2, orders and the scene by a gateway. `docs/across-machines.md`."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import socket
import threading
from collections.abc import Iterator
from typing import Any, BinaryIO, NoReturn, Self, TypeVar

import numpy as np

from . import token as tokens
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
    WrongToken,
)
from .orders import Ack, Order
from .scene import Scene
from .session import Session, check_version
from .timeouts import seconds
from .transport import Belonging
from .wire import GaussianRest, Hello, ObjectInfo, Record, SceneHeader

R = TypeVar("R", bound=Record)

MAX_ANSWER = 1 << 20
"""Longest line of an answer [byte]; 32 acknowledgements take some ten thousand."""

_RAISED = {
    kind.__name__: kind
    for kind in (BadName, Malformed, NoServer, ServerLost, TimedOut, TransportFailed, Unanswered, WrongToken)
}


def connect(
    address: str, port: int, *, token: str | None = None, timeout: float = 30.0, domain: Domain | None = None
) -> RemoteSession:
    """Attaches to the session of a gateway, whose streams a tunnel brings to this machine's `domain`.

    `token` is what the gateway printed as it began; without it, that of the environment variable COSPLAT_TOKEN. Waits up to
    `timeout` [s] for the gateway, for the tunnel, and for every answer. Raises NoServer, WrongToken, OtherVersion, Malformed for
    answers that are none, and TimedOut when the streams do not come.
    """
    remote = Remote(address, port, token=token, timeout=timeout)
    try:
        return RemoteSession(remote, timeout, domain or Domain.from_env())
    except BaseException:
        remote.close()
        raise


class Remote:
    """Sends orders by a gateway on another machine, with the answers and exceptions of `Session.send`.

    A gateway hangs up on who is silent where its places are rare, and as it ends. The next request then connects anew.
    Threads may share it: their requests are made one after the other.
    """

    def __init__(self, address: str, port: int, *, token: str | None = None, timeout: float = 10.0) -> None:
        """Connects, waiting up to `timeout` [s] for this and for every answer.

        `token` is what the gateway printed as it began; without it, that of the environment variable COSPLAT_TOKEN. Raises
        NoServer, and WrongToken where there is no token; whether it is right, the first request says.
        """
        known = tokens.from_env() if token is None else token
        if known is None:
            raise WrongToken(f"there is no token: give `token`, or set {tokens.VARIABLE}, to what the gateway printed")
        self._token = known
        # For a socket 0 is another mode, and None as long as it takes.
        wait = max(1e-3, seconds(timeout))
        self._address, self._timeout = (address, port), wait if wait < threading.TIMEOUT_MAX else None
        self._connection: tuple[socket.socket, BinaryIO] | None = self._connect()
        self._is_closed = False
        self._turn = Belonging(threading.RLock())

    def send(self, *orders: Order) -> list[Ack]:
        """Sends 1 to 32 orders and waits for their answers.

        Raises Refused when one is refused, BadName for names that the scene or the gateway does not have, Malformed for
        what is no order, WrongToken, Unanswered when no answer comes, and what the gateway itself meets.
        """
        if not orders:
            return []
        entries = [{"order": type(order).__name__, **_fields(order)} for order in orders]
        with self._understood():
            acks = [_ack(*ack) for ack in self._ask({"orders": entries})["acks"]]
            if len(acks) != len(orders):
                raise ValueError(f"{len(acks)} acknowledgements of {len(orders)} orders")
        if not all(ack.accepted for ack in acks):
            raise Refused(acks)
        return acks

    def hello(self) -> tuple[str, Hello]:
        """The name of the session, and the greeting of its server."""
        with self._understood():
            answer = self._ask({"ask": "hello"})
            return str(answer["session"]), _record(Hello, answer["hello"])

    def scene(self) -> Scene:
        """The scene of the server's present run."""
        with self._turn.native, self._understood():
            answer = self._ask({"ask": "scene"})
            sizes = answer["sizes"]
            if not all(isinstance(size, int) and size >= 0 for size in sizes):
                raise Malformed(f"blocks of {sizes} bytes, expected sizes")
            gaussians, sh, objects, features, source = [self._read(size) for size in sizes]
            # The gateway hangs up behind a scene.
            self._drop()
            return Scene(
                _record(SceneHeader, answer["scene"]),
                np.frombuffer(gaussians, GaussianRest.dtype),
                np.frombuffer(sh, "<f4"),
                np.frombuffer(objects, ObjectInfo.dtype),
                np.frombuffer(features, "<f4"),
                source.decode(errors="replace"),
            )

    def _read(self, size: int) -> bytes:
        try:
            block = self._connection[1].read(size) if self._connection else b""
        except OSError as error:
            self._drop()
            raise Unanswered(f"the scene did not come: {error}") from None
        if len(block) != size:
            self._drop()
            raise Unanswered("the gateway hung up in the middle of the scene")
        return block

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        try:
            text = json.dumps({"token": self._token, **request}, default=lambda value: value.tolist())
        except (TypeError, ValueError, AttributeError, RecursionError) as error:
            raise Malformed(f"an order cannot be sent: {error}") from None
        with self._turn.native:
            if self._is_closed:
                raise NoServer(f"this connection to the gateway at {self._address[0]}:{self._address[1]} is closed")
            if self._connection is None or self._is_left():
                self._drop()
                self._connection = self._connect()
            own, answers = self._connection
            try:
                own.sendall(text.encode() + b"\n")
                line = answers.readline(MAX_ANSWER)
            except OSError as error:
                # Its answer may still come, and is not that of the next request.
                self._drop()
                raise Unanswered(f"no answer from the gateway: {error}") from None
            if not line.endswith(b"\n"):
                self._drop()
                if len(line) == MAX_ANSWER:
                    raise Malformed(f"the gateway's answer has more than {MAX_ANSWER} bytes")
                raise Unanswered("the gateway hung up: orders that the server has looked at take effect")
            answer: dict[str, Any] = json.loads(line)
            if "error" in answer:
                raise _RAISED.get(answer["error"]["kind"], CosplatError)(answer["error"]["words"])
            return answer

    def _connect(self) -> tuple[socket.socket, BinaryIO]:
        try:
            own = socket.create_connection(self._address, self._timeout)
        except OSError as error:
            raise NoServer(f"no gateway at {self._address[0]}:{self._address[1]}: {error}") from None
        return own, own.makefile("rb")

    def _is_left(self) -> bool:
        """Whether the gateway has hung up since the last request."""
        if self._connection is None:
            return True
        own, _ = self._connection
        try:
            own.setblocking(False)
            return not own.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            return True
        finally:
            own.settimeout(self._timeout)

    def _drop(self) -> None:
        if self._connection is not None:
            for end in reversed(self._connection):
                end.close()
            self._connection = None

    @contextlib.contextmanager
    def _understood(self) -> Iterator[None]:
        try:
            yield
        except CosplatError:
            raise
        except Exception as error:
            self._drop()
            raise Malformed(f"the gateway's answer is none: {error!r:.300}") from error

    def another(self) -> Remote:
        """One more connection to the same gateway. Raises NoServer."""
        address, port = self._address
        timeout = math.inf if self._timeout is None else self._timeout
        return Remote(address, port, token=self._token, timeout=timeout)

    def close(self) -> None:
        """Hangs up."""
        with self._turn.native:
            self._is_closed = True
            self._drop()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class RemoteSession(Session):
    """A session on another machine; made by `connect`. Lock-step is not carried.

    Who publishes under the session's name in this domain is believed: the tunnel's messages do not say who sent them.
    """

    def __init__(self, remote: Remote, timeout: float, domain: Domain) -> None:
        self._remote = remote
        name, hello = remote.hello()
        super().__init__(name, timeout, domain, "remote", greeting=_RemoteGreeting(remote, hello))

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
        # Through a connection of its own: orders do not wait for a slow network.
        with self._remote.another() as remote:
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


def _ack(sequence: Any, step: Any, accepted: Any, reason: Any) -> Ack:
    kinds = (sequence, int), (step, int), (accepted, bool), (reason, str)
    if not all(isinstance(value, kind) for value, kind in kinds):
        raise TypeError(f"{[sequence, step, accepted, reason]} acknowledges nothing")
    return Ack(sequence, step, accepted, reason)


def _record(kind: type[R], fields: dict[str, Any]) -> R:
    """A wire type from JSON, of values that it can have."""
    [element] = np.zeros(1, kind.dtype)
    for name in kind.dtype.names or ():
        value = fields[name]
        element[name] = value.encode() if isinstance(value, str) else value
    return kind.read(element)


def _fields(order: Order) -> dict[str, Any]:
    return {field.name: getattr(order, field.name) for field in dataclasses.fields(order)}
