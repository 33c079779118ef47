"""Requests with orders, and the answers to them."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import transport, wire
from .errors import CosplatError, NoServer, ServerLost, TimedOut, TransportFailed, Unanswered
from .orders import Ack

if TYPE_CHECKING:
    from .session import Session

RETRY_PERIOD = 0.005


class RequestPort:
    """Sends requests on one stream; the answers' acknowledgements are checked against what was sent."""

    def __init__(
        self, session: Session, stream: str, header: type[wire.Record], answer_header: type[wire.Record] | None = None
    ) -> None:
        self._session = session
        self._header = header
        self._service = session.open(
            lambda node, name: transport.requests(node, name, wire.Command, header, wire.Ack, answer_header), stream
        )
        self._port = transport.sender(self._service, wire.MAX_COMMANDS)
        self._listener = session.open(transport.event, stream).listener_builder().create()
        # One event wakes the server for requests of all kinds.
        self._notifier = session.open(transport.event, "command").notifier_builder().create()
        self._sequence = 0

    def ask(
        self, commands: NDArray[np.void], header: dict[str, Any], timeout: float | None
    ) -> tuple[Any, list[Ack]]:
        """Sends commands and waits for the answer: the response and one acknowledgement per command.

        Without a timeout it waits for as long as the server lives.
        """
        count = len(commands)
        first = self._sequence + 1
        self._sequence += count
        commands["sequence"] = range(first, first + count)
        head = np.zeros((), self._header.dtype)
        for name, value in {**header, "pid": os.getpid(), "count": count}.items():
            head[name] = value
        start = time.monotonic()
        pending = self._deliver(commands, head, timeout)
        response = self._wait(pending, start, timeout)
        acks = [Ack.read(element) for element in transport.array(response, self._port, wire.Ack.dtype)]
        if [ack.sequence for ack in acks] != list(range(first, first + count)):
            raise TransportFailed(f"the server answered {len(acks)} of {count} orders")
        return response, acks

    def _deliver(self, commands: NDArray[np.void], head: NDArray[np.void], timeout: float | None) -> Any:
        start = time.monotonic()
        while (pending := transport.send(self._port, commands, head)) is None:
            waited = time.monotonic() - start
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
