"""A gateway beside the server, for other machines: it takes orders, and gives what is sent once. `cosplat.remote` speaks to it.

    python -m cosplat.gateway SESSION --listen ADDRESS:PORT

A request is a line of JSON, `{"orders": [{"order": "Push", "object": "left", "impulse": [0, 1, 0]}]}`. Its answer is a line with
`acks`, lists of what `Ack` has, or with `error`, the name of an exception of this package and its sentence. `{"ask": "hello"}` is
answered by the session's name and the greeting of its server; `{"ask": "scene"}` by a header with the sizes of five blocks, the blocks, and
the end of the connection.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import logging
import selectors
import socket
import sys
import threading
from typing import Any, Self

import numpy as np

from . import orders
from .errors import BadName, CosplatError, Malformed, Refused, TransportFailed
from .orders import Order
from .scene import Scene
from .session import Session, connect

MAX_CONNECTIONS = 16
MAX_SCENES = 4
"""Scenes that are sent at a time."""
SCENE_TIMEOUT = 600.0
"""Longest that one of them may take [s]."""
MAX_LINE = 64 * 1024
"""Longest request [byte]; 32 orders take some ten thousand."""

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

_log = logging.getLogger("cosplat")


class Gateway:
    """Takes orders from a socket and sends them to a session, one request after the other. One thread has it."""

    def __init__(self, session: Session, address: str, port: int) -> None:
        """Listens at `address` and `port` alone; 0 for a free port. Raises OSError where it cannot."""
        self._session = session
        family = socket.AF_INET6 if ":" in address else socket.AF_INET
        self._listener = socket.create_server((address, port), family=family)
        self._listener.setblocking(False)
        self.address: tuple[str, int] = self._listener.getsockname()[:2]
        """Where it listens."""
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._unread: dict[socket.socket, bytes] = {}
        self._scenes: list[threading.Thread] = []

    def serve(self, timeout: float | None = None) -> None:
        """Waits up to `timeout` [s], without one as long as it takes, and answers what came."""
        for key, _ in self._selector.select(timeout):
            if key.fileobj is self._listener:
                self._accept()
            elif isinstance(key.fileobj, socket.socket):
                self._read(key.fileobj)

    def close(self) -> None:
        """Listens no more, and hangs up."""
        for connection in list(self._unread):
            self._hang_up(connection)
        self._selector.close()
        self._listener.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _accept(self) -> None:
        try:
            connection, peer = self._listener.accept()
        except OSError:
            # It hung up before its turn.
            return
        # An answer is short: whoever does not take it is hung up on.
        connection.settimeout(1.0)
        if len(self._unread) >= MAX_CONNECTIONS:
            with contextlib.suppress(OSError), connection:
                connection.sendall(_error(TransportFailed(f"{MAX_CONNECTIONS} connections are open, and no more are taken")))
            return
        _log.info("gateway: %s is connected", peer[0])
        self._unread[connection] = b""
        self._selector.register(connection, selectors.EVENT_READ)

    def _read(self, connection: socket.socket) -> None:
        try:
            data = connection.recv(MAX_LINE)
            *lines, rest = (self._unread[connection] + data).split(b"\n")
            for line in lines:
                asked = _asked(line)
                if asked == "scene":
                    self._give_scene(connection)
                    return
                connection.sendall(self._greeting() if asked == "hello" else self._answer(line))
            if len(rest) > MAX_LINE:
                connection.sendall(_error(Malformed(f"a request has more than {MAX_LINE} bytes")))
                data = b""
        except OSError:
            data = b""
        if data:
            self._unread[connection] = rest
        else:
            self._hang_up(connection)

    def _hang_up(self, connection: socket.socket) -> None:
        self._selector.unregister(connection)
        del self._unread[connection]
        connection.close()

    def _greeting(self) -> bytes:
        hello = {"session": self._session.name, "hello": fields_of(self._session.hello)}
        return json.dumps(hello).encode() + b"\n"

    def _give_scene(self, connection: socket.socket) -> None:
        """Has a thread send the scene, as orders are not to wait for a slow network."""
        self._selector.unregister(connection)
        del self._unread[connection]
        self._scenes = [thread for thread in self._scenes if thread.is_alive()]
        try:
            if len(self._scenes) >= MAX_SCENES:
                raise TransportFailed(f"{MAX_SCENES} scenes are being sent, and no more are: try again")
            parts = _scene_parts(self._session.scene())
        except CosplatError as error:
            with contextlib.suppress(OSError), connection:
                connection.sendall(_error(error))
            return
        connection.settimeout(SCENE_TIMEOUT)

        def send() -> None:
            with contextlib.suppress(OSError), connection:
                for part in parts:
                    connection.sendall(part)

        self._scenes.append(threading.Thread(target=send, daemon=True))
        self._scenes[-1].start()

    def _answer(self, line: bytes) -> bytes:
        try:
            acks = self._session.send(*_orders(line))
        except Refused as refused:
            acks = refused.acks
        except CosplatError as error:
            return _error(error)
        except (ValueError, TypeError, OverflowError) as error:
            return _error(Malformed(f"an order cannot be sent: {error}"))
        return json.dumps({"acks": acks}).encode() + b"\n"


def _asked(line: bytes) -> Any:
    if b'"ask"' not in line:
        return None
    with contextlib.suppress(ValueError, RecursionError):
        request = json.loads(line)
        return request.get("ask") if isinstance(request, dict) else None


def _orders(line: bytes) -> list[Order]:
    try:
        entries = json.loads(line)["orders"]
        fields = [dict(entry) for entry in entries]
        kinds = [str(entry.pop("order")) for entry in fields]
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise Malformed(f'a request is no line of JSON like {{"orders": [{{"order": "Pause"}}]}}: {error!r}') from None
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
    parser = argparse.ArgumentParser(prog="python -m cosplat.gateway", description="Takes orders for a session from a socket.")
    parser.add_argument("session")
    parser.add_argument("--listen", default="127.0.0.1:7400", metavar="ADDRESS:PORT", help="an address of this machine")
    arguments = parser.parse_args()
    address, _, port = arguments.listen.rpartition(":")
    if not address or not port.isdigit():
        parser.error(f"--listen {arguments.listen}: expected ADDRESS:PORT, like 127.0.0.1:7400 or [::1]:7400")
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    try:
        with connect(arguments.session) as session, Gateway(session, address.strip("[]"), int(port)) as gateway:
            print(f"session {session.name!r} takes orders at {gateway.address[0]} port {gateway.address[1]}", flush=True)
            while True:
                gateway.serve()
    except (CosplatError, OSError, OverflowError) as error:
        sys.exit(str(error))
    except KeyboardInterrupt:
        pass


if __name__ == "__main__":
    main()
