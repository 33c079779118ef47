"""Requests with orders, and the answers to them."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any, NamedTuple

from . import transport, wire
from .errors import CosplatError, NoServer, ServerLost, TimedOut, TransportFailed, Unanswered
from .orders import Ack, Order, encode

if TYPE_CHECKING:
    from .session import Session

RETRY_PERIOD = 0.005


class Sent(NamedTuple):
    """A request on its way. Dropped before the server looked at it, it is dropped unseen."""

    pending: Any
    first: int
    order_count: int
    start: float


class RequestPort:
    """Sends requests on one stream; the answers' acknowledgements are checked against what was sent."""

    def __init__(
        self, session: Session, stream: str, header: type[wire.Record], answer_header: type[wire.Record] | None = None
    ) -> None:
        self._session = session
        self._service = session.open(
            lambda node, name: transport.requests(node, name, wire.Command, header, wire.Ack, answer_header), stream
        )
        self._port = transport.sender(self._service, wire.MAX_COMMANDS)
        self._listener = transport.Listener(session.open(transport.event, stream))
        # One event wakes the server for requests of all kinds.
        self._notifier = transport.notifier(session.open(transport.event, "command"))
        self._header_size: int = answer_header.dtype.itemsize if answer_header else 0
        self._sequence = 0
        # Several threads may send; one request is made at a time, and answers are waited for side by side.
        self._lock = transport.Belonging(threading.RLock())

    def submit(
        self, orders: tuple[Order, ...], head: bytes, timeout: float | None, *, awaits_server: bool = True
    ) -> Sent:
        """Sends orders under a header, waiting up to `timeout` [s] (5 without) for a place in the server's queue.

        Raises BadName, NoServer, TimedOut, and ValueError for more than 32 orders. Who does not await a server gets ServerLost
        at once where there is none.
        """
        count = len(orders)
        if count > wire.MAX_COMMANDS:
            raise ValueError(f"{count} orders in one request, expected at most {wire.MAX_COMMANDS}")
        scene = self._session.scene() if orders else None
        with self._lock.native:
            first = self._sequence + 1
            commands = encode(orders, scene, first) if scene is not None else b""
            self._sequence += count
        start = time.monotonic()
        pending = self._deliver(count, commands, head, start, timeout, awaits_server)
        return Sent(pending, first, count, start)

    def answer(self, sent: Sent, timeout: float | None) -> tuple[bytes, list[Ack]]:
        """Waits for the answer to what was sent: its header, empty where it has none, and one acknowledgement per order.

        `timeout` [s] counts from the sending; without, it waits for as long as the server lives. Raises Unanswered, ServerLost.
        """
        response = self._wait(sent.pending, sent.start, timeout)
        acks = Ack.read_all(transport.payload(response, wire.Ack))
        header = transport.user_header(response, self._header_size) if self._header_size else b""
        # Who keeps a refusal keeps the frames that it passed, and with them the request: it would take a place of further ones.
        response.delete()
        sent.pending.delete()
        if len(acks) != sent.order_count or any(ack.sequence != sent.first + index for index, ack in enumerate(acks)):
            raise TransportFailed(f"the server answered {len(acks)} of {sent.order_count} orders")
        return header, acks

    def _deliver(
        self, count: int, commands: bytes, head: bytes, start: float, timeout: float | None, awaits_server: bool
    ) -> Any:
        while True:
            with self._lock.native:
                pending = transport.send(self._port, count, commands, head)
            if pending is not None:
                break
            waited = time.monotonic() - start
            if not awaits_server and self._service.dynamic_config.number_of_servers == 0:
                raise ServerLost("the server ended before it heard of the orders")
            if waited >= (5.0 if timeout is None else timeout):
                if self._service.dynamic_config.number_of_servers == 0:
                    raise NoServer(f"no server took the orders within {waited:.1f} s")
                raise TimedOut(f"the server's queue was full for {waited:.1f} s: the orders were not sent")
            time.sleep(RETRY_PERIOD)
        transport.notify(self._notifier)
        return pending

    def _wait(self, pending: Any, start: float, timeout: float | None) -> Any:
        while True:
            left = 0.5 if timeout is None else max(0.0, timeout - (time.monotonic() - start))
            response = transport.answer(pending, self._listener, left)
            if response is not None:
                return response
            waited = time.monotonic() - start
            is_open = pending.is_connected
            if timeout is not None or not is_open:
                raise self._unanswered(is_open, waited)
            # A server that is killed does not let go of a request.
            if self._session.is_over(0):
                raise self._unanswered(False, waited)

    def _unanswered(self, is_open: bool, waited: float) -> CosplatError:
        if self._service.dynamic_config.number_of_servers == 0:
            return ServerLost(f"the server ended {waited:.1f} s after the orders were sent")
        if is_open:
            return Unanswered(f"no answer for {waited:.1f} s: the orders take effect if the server has looked at them")
        return Unanswered(f"the answer was lost after {waited:.1f} s: orders that were accepted take effect")
