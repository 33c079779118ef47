"""A gateway beside the server, for other machines: it takes orders, and gives what is sent once. `cosplat.remote` speaks to it.

    python -m cosplat.gateway SESSION --listen ADDRESS:PORT

A request is a line of JSON, `{"token": "...", "orders": [{"order": "Push", "object": "left", "impulse": [0, 1, 0]}]}`. Its answer is a
line with `acks`, lists of what `Ack` has, or with `error`, the name of an exception of this package and its sentence. `"ask": "hello"` in
place of `orders` is answered by the session's name and the greeting of its server; `"ask": "scene"` by a header with the sizes of five
blocks, the blocks, and the end of the connection.

Any web site that a user visits can make a browser send bytes to a port of this machine. So every request shows the token, and whoever
sends what is no JSON object, or another token, is hung up on: the first line of HTTP is no JSON object.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import hmac
import ipaddress
import json
import logging
import math
import selectors
import socket
import sys
import time
from collections import deque
from typing import Any, Self

import numpy as np

from . import orders, token
from .errors import BadName, CosplatError, Malformed, Refused, TransportFailed, WrongToken
from .orders import Order
from .scene import Scene
from .session import Session, connect

MAX_CONNECTIONS = 16
"""Connections that have shown the token, but for those that a scene is sent to."""
MAX_STRANGERS = 64
"""Connections that have not; one more takes the place of the oldest."""
PATIENCE = 10.0
"""Longest that a stranger may take for its first request, and that a reader may take nothing of its answer [s]."""
SILENCE = 10.0
"""After so long without a request a connection loses its place, where another one wants it [s]."""
MAX_SCENES = 4
"""Scenes that are sent at a time."""
SCENE_TIMEOUT = 600.0
"""Longest that one of them may take [s]."""
MAX_LINE = 64 * 1024
"""Longest request [byte]; 32 orders take some ten thousand."""
PORTION = 256 * 1024
"""Most that is sent to one connection before others have their turn [byte]."""

# What ends the server or writes its files takes a shell on its machine.
ALLOWED: dict[str, type[Order]] = {
    kind.__name__: kind
    for kind in (
        orders.Push,
        orders.SetVelocity,
        orders.SetMaterial,
        orders.SetGravity,
        orders.MoveCollider,
        orders.Pin,
        orders.Release,
        orders.Grab,
        orders.Drag,
        orders.LetGo,
        orders.SetPose,
        orders.SetFidelity,
        orders.Remove,
        orders.BringIn,
        orders.Undo,
        orders.Redo,
        orders.Cancel,
        orders.Force,
        orders.ColliderVelocity,
        orders.Save,
        orders.Restore,
        orders.Step,
        orders.Pause,
        orders.Resume,
        orders.Reset,
    )
}

_EXPECTED = 'a request is no line of JSON like {"token": "...", "orders": [{"order": "Pause"}]}'
_log = logging.getLogger("cosplat")


@dataclasses.dataclass(eq=False)
class _Peer:
    """A connection."""

    socket: socket.socket
    address: str
    deadline: float
    """When it is hung up on, unless it does before what is waited for."""
    end: float = math.inf
    """When it is hung up on whatever it does."""
    heard: float = 0.0
    """When its last request came."""
    unread: bytes = b""
    unsent: deque[memoryview] = dataclasses.field(default_factory=deque)
    is_known: bool = False
    """It has shown the token."""
    has_scene: bool = False
    is_leaving: bool = False
    """It is hung up on as soon as all is sent."""


class Gateway:
    """Takes orders from a socket and sends them to a session, one request after the other. One thread has it.

    No connection is waited for: who takes no answer, says nothing or comes in numbers holds up nobody else.
    """

    def __init__(self, session: Session, address: str, port: int, known: str | None = None) -> None:
        """Listens at `address` and `port` alone; 0 for a free port. Raises OSError where it cannot.

        `known` is the token that requests have to show; without it a new one is made. Raises WrongToken for one that is too short.
        """
        self._session = session
        self.token: str = token.new() if known is None else token.checked(known)
        """What requests have to show."""
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        self._listener = socket.create_server((address, port), family=family)
        self._listener.setblocking(False)
        self.address: tuple[str, int] = self._listener.getsockname()[:2]
        """Where it listens."""
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        # From the oldest to the newest.
        self._peers: dict[socket.socket, _Peer] = {}

    def serve(self, timeout: float | None = None) -> None:
        """Waits up to `timeout` [s], without one as long as it takes, and answers what came."""
        due = min((min(peer.deadline, peer.end) for peer in self._peers.values()), default=math.inf) - time.monotonic()
        wait = min(due, math.inf if timeout is None else timeout)
        ready = self._selector.select(None if wait == math.inf else max(0.0, wait))
        for key, _ in ready:
            # One that was here may have lost its place to another.
            if isinstance(key.fileobj, socket.socket) and (peer := self._peers.get(key.fileobj)):
                if peer.unsent:
                    self._send(peer)
                    self._answer_lines(peer)
                else:
                    self._read(peer)
        # Whoever has a request here is heard before newcomers take places.
        if any(key.fileobj is self._listener for key, _ in ready):
            self._accept()
        now = time.monotonic()
        for peer in [peer for peer in self._peers.values() if now > min(peer.deadline, peer.end)]:
            self._hang_up(peer)

    def close(self) -> None:
        """Listens no more, and hangs up."""
        for peer in list(self._peers.values()):
            self._hang_up(peer)
        self._selector.close()
        self._listener.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        # Not without end: those that are there have their turn again.
        for _ in range(MAX_STRANGERS):
            try:
                connection, address = self._listener.accept()
            except OSError:
                # There is none, or it hung up before its turn.
                return
            strangers = [peer for peer in self._peers.values() if not peer.is_known]
            if len(strangers) >= MAX_STRANGERS:
                self._hang_up(strangers[0])
            connection.setblocking(False)
            self._peers[connection] = _Peer(connection, address[0], time.monotonic() + PATIENCE)
            self._selector.register(connection, selectors.EVENT_READ)

    def _read(self, peer: _Peer) -> None:
        try:
            data = peer.socket.recv(MAX_LINE)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._hang_up(peer)
            return
        peer.unread += data
        self._answer_lines(peer)

    def _answer_lines(self, peer: _Peer) -> None:
        """Answers the requests that came whole; the next one waits where an answer is not taken."""
        while not peer.unsent and not peer.is_leaving:
            line, end, rest = peer.unread.partition(b"\n")
            if len(line) > MAX_LINE:
                self._refuse(peer, Malformed(f"a request has more than {MAX_LINE} bytes"))
            elif not end:
                return
            else:
                peer.unread = rest
                self._answer_line(peer, line)

    def _answer_line(self, peer: _Peer, line: bytes) -> None:
        try:
            request = _request(line)
            if not self._is_shown(request):
                raise WrongToken("the token is missing or wrong: `token` has to be what the gateway printed as it began")
            self._let_in(peer)
        except CosplatError as error:
            self._refuse(peer, error)
            return
        peer.heard = time.monotonic()
        match request.get("ask"):
            case "scene":
                self._give_scene(peer)
            case "hello":
                self._tell(peer, self._greeting())
            case _:
                self._tell(peer, self._answer(request))

    def _is_shown(self, request: dict[str, Any]) -> bool:
        shown = request.get("token")
        # Time says nothing of how many characters are right.
        return isinstance(shown, str) and hmac.compare_digest(shown.encode(errors="surrogatepass"), self.token.encode())

    def _let_in(self, peer: _Peer) -> None:
        """Gives a place to whoever has shown the token."""
        if peer.is_known:
            return
        others = [other for other in self._peers.values() if other.is_known and not other.has_scene]
        if len(others) >= MAX_CONNECTIONS:
            quietest = min(others, key=lambda other: other.heard)
            if quietest.unsent or time.monotonic() < quietest.heard + SILENCE:
                raise TransportFailed(f"{MAX_CONNECTIONS} connections are open, and no more are taken")
            self._hang_up(quietest)
        peer.is_known = True
        peer.deadline = math.inf
        _log.info("gateway: %s is connected", peer.address)

    def _refuse(self, peer: _Peer, error: CosplatError) -> None:
        """Says why, and hangs up."""
        peer.is_leaving = True
        self._tell(peer, _error(error))

    def _tell(self, peer: _Peer, *parts: bytes) -> None:
        peer.unsent.extend(memoryview(part) for part in parts if part)
        peer.deadline = time.monotonic() + PATIENCE
        self._send(peer)

    def _send(self, peer: _Peer) -> None:
        """Sends what the other end takes now."""
        left = PORTION
        try:
            while peer.unsent and left > 0:
                sent = peer.socket.send(peer.unsent[0][:left])
                left -= sent
                peer.deadline = time.monotonic() + PATIENCE
                peer.unsent[0] = peer.unsent[0][sent:]
                if not peer.unsent[0]:
                    peer.unsent.popleft()
        except BlockingIOError:
            pass
        except OSError:
            self._hang_up(peer)
            return
        if peer.unsent:
            self._selector.modify(peer.socket, selectors.EVENT_WRITE)
        elif peer.is_leaving:
            self._hang_up(peer)
        else:
            peer.deadline = math.inf
            self._selector.modify(peer.socket, selectors.EVENT_READ)

    def _hang_up(self, peer: _Peer) -> None:
        peer.is_leaving = True
        peer.unsent.clear()
        if self._peers.pop(peer.socket, None):
            self._selector.unregister(peer.socket)
            peer.socket.close()

    def _greeting(self) -> bytes:
        hello = {"session": self._session.name, "hello": fields_of(self._session.hello)}
        return json.dumps(hello).encode() + b"\n"

    def _give_scene(self, peer: _Peer) -> None:
        try:
            if sum(other.has_scene for other in self._peers.values()) >= MAX_SCENES:
                raise TransportFailed(f"{MAX_SCENES} scenes are being sent, and no more are: try again")
            parts = _scene_parts(self._session.scene())
        except CosplatError as error:
            self._refuse(peer, error)
            return
        peer.has_scene = peer.is_leaving = True
        peer.end = time.monotonic() + SCENE_TIMEOUT
        self._tell(peer, *parts)

    def _answer(self, request: dict[str, Any]) -> bytes:
        try:
            acks = self._session.send(*_orders(request))
        except Refused as refused:
            acks = refused.acks
        except CosplatError as error:
            return _error(error)
        except (ValueError, TypeError, OverflowError) as error:
            return _error(Malformed(f"an order cannot be sent: {error}"))
        return json.dumps({"acks": acks}).encode() + b"\n"


def _request(line: bytes) -> dict[str, Any]:
    try:
        request = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise Malformed(f"{_EXPECTED}: {error!r}") from None
    if not isinstance(request, dict):
        raise Malformed(f"{_EXPECTED}: it is of type {type(request).__name__}")
    return request


def _orders(request: dict[str, Any]) -> list[Order]:
    try:
        fields = [dict(entry) for entry in request["orders"]]
        kinds = [str(entry.pop("order")) for entry in fields]
    except (ValueError, TypeError, KeyError) as error:
        raise Malformed(f"{_EXPECTED}: {error!r}") from None
    for kind in kinds:
        if kind not in ALLOWED:
            raise BadName(f"order {kind!r} is not taken from afar: expected one of {', '.join(ALLOWED)}")
    return [ALLOWED[kind](**entry) for kind, entry in zip(kinds, fields, strict=True)]


def fields_of(record: Any) -> dict[str, Any]:
    """The fields of a wire type as JSON has them."""
    values = {field.name: getattr(record, field.name) for field in dataclasses.fields(record)}
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value.decode(errors="replace") if isinstance(value, bytes) else value
        for name, value in values.items()
    }


def _scene_parts(scene: Scene) -> list[bytes]:
    blocks = [scene.gaussians.tobytes(), scene.sh.tobytes(), scene.objects.tobytes(), scene.features.tobytes()]
    blocks.append(scene.source.encode())
    head = {"scene": fields_of(scene.header), "sizes": [len(block) for block in blocks]}
    return [json.dumps(head).encode() + b"\n", *blocks]


def _error(error: CosplatError) -> bytes:
    return json.dumps({"error": {"kind": type(error).__name__, "words": str(error)}}).encode() + b"\n"


def main() -> None:
    """Serves until it is interrupted."""
    parser = argparse.ArgumentParser(
        prog="python -m cosplat.gateway",
        description="Takes orders for a session from a socket.",
        epilog=f"Requests show a token. It is printed, new each time, unless {token.VARIABLE} is set.",
    )
    parser.add_argument("session")
    parser.add_argument("--listen", default="127.0.0.1:7400", metavar="ADDRESS:PORT", help="an address of this machine")
    arguments = parser.parse_args()
    address, _, port = arguments.listen.rpartition(":")
    if not address or not port.isdigit():
        parser.error(f"--listen {arguments.listen}: expected ADDRESS:PORT, like 127.0.0.1:7400 or [::1]:7400")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    try:
        known = token.from_env()
        with connect(arguments.session) as session, Gateway(session, address.strip("[]"), int(port), known) as gateway:
            host, number = gateway.address
            if not ipaddress.ip_address(host.partition("%")[0]).is_loopback:
                _log.warning("other machines reach %s: whoever has the token may give orders, and nothing is encrypted", host)
            shown = f"of {token.VARIABLE}" if known else gateway.token
            print(f"session {session.name!r} takes orders at {host} port {number} with the token {shown}", flush=True)
            while True:
                gateway.serve()
    except (CosplatError, OSError, OverflowError) as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
