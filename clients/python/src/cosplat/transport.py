"""The one module that speaks to iceoryx2 about services, and the only one that touches addresses.

Memory leaves it as numpy arrays that cannot be written and keep their sample alive. What iceoryx2 hands out leaves it as a `Belonging`.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import os
import struct
import threading
import time
import weakref
from typing import Any, NoReturn, TypeVar

import iceoryx2 as iox2
import numpy as np
from numpy.typing import NDArray

from . import wire
from .domain import SHARED_MEMORY
from .errors import OtherProcess, TooManyHeld, TransportFailed
from .packing import packer

R = TypeVar("R", bound=wire.Record)

# Made once, as they go with every request.
_REQUEST = iox2.EventId.new(1)
_SHORT_WAIT_S = 0.05
_SHORT_WAIT = iox2.Duration.from_secs_f64(_SHORT_WAIT_S)
# A message may come without a wake-up: history after joining.
LONGEST_WAIT = 0.02


class Belonging:
    """A node, service, port, message or lock of the process that made it; it has the attributes of what is in it.

    A forked child inherits all of them. What it dropped would be taken from its parent: a port its place, a message its memory.
    So a child keeps whatever it inherited until it is gone, and uses nothing of it. Attributes raise OtherProcess there.
    """

    __slots__ = ("__weakref__", "_native", "_process")

    def __init__(self, native: Any) -> None:
        self._native = native
        self._process = os.getpid()
        _belongings.add(self)

    @property
    def native(self) -> Any:
        """What is in it. Raises OtherProcess in a forked child."""
        if self._native is None:
            raise OtherProcess(
                f"process {self._process} attached to the session, and this is its forked child {os.getpid()}: "
                "call `cosplat.connect` here, after the fork"
            )
        return self._native

    def __getattr__(self, name: str) -> Any:
        return getattr(self.native, name)

    def __reduce__(self) -> NoReturn:
        raise TypeError("what is attached to a session cannot be sent to another process: call `cosplat.connect` there")


_belongings: weakref.WeakSet[Belonging] = weakref.WeakSet()


def _leave_to_the_parent() -> None:
    """In a forked child: nothing of what the parent has is ever dropped here, not even when the interpreter ends."""
    kept = []
    for belonging in list(_belongings):
        kept.append(belonging._native)
        belonging._native = None
    _belongings.clear()
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(kept))


os.register_at_fork(after_in_child=_leave_to_the_parent)


class Absent(Exception):
    """A service does not exist yet, or is about to come or to go: worth another try."""


class Corrupted(Exception):
    """Another release of iceoryx2 made a service, or its files are damaged."""


_PASSING = ("DoesNotExist", "IsMarkedForDestruction", "HangsInCreation", "IsBeingCreated", "SystemInFlux")


def structure(record: type[wire.Record]) -> type[ctypes.Structure]:
    """A type with the name, size and alignment of a wire type, which is all that iceoryx2 compares."""
    # A reader may ask for less than the 64 bytes of a Gaussian.
    unit = ctypes.c_uint64 if record.alignment >= 8 else ctypes.c_uint32
    count = record.dtype.itemsize // ctypes.sizeof(unit)
    name = record.type_name
    members = {"_fields_": [("words", unit * count)], "type_name": staticmethod(lambda: name)}
    return type(record.__name__, (ctypes.Structure,), members)


def _payload(element: type[wire.Record] | str) -> Any:
    primitives = {"f32": ctypes.c_float, "u8": ctypes.c_uint8}
    return primitives[element] if isinstance(element, str) else structure(element)


def _opened(builder: Any, name: str) -> Any:
    try:
        return Belonging(builder.open())
    except Exception as error:
        words = str(error)
        if any(word in words for word in _PASSING):
            raise Absent(f"{name} does not exist") from None
        if "Corrupted" in words or "VersionMismatch" in words:
            raise Corrupted(f"{name} is damaged") from None
        raise TransportFailed(f"cannot open {name}: {words}") from None


def pub_sub(node: Any, name: str, payload: type[wire.Record] | str, header: type[wire.Record] | None) -> Any:
    """Opens a stream of slices."""
    builder = node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(iox2.Slice[_payload(payload)])
    return _opened(builder if header is None else builder.user_header(structure(header)), name)


def single(node: Any, name: str, payload: type[wire.Record]) -> Any:
    """Opens a stream of single elements without header."""
    builder = node.service_builder(iox2.ServiceName.new(name)).publish_subscribe(structure(payload))
    return _opened(builder, name)


def event(node: Any, name: str) -> Any:
    """Opens an event service."""
    return _opened(node.service_builder(iox2.ServiceName.new(name)).event(), name)


def requests(
    node: Any,
    name: str,
    request: type[wire.Record],
    header: type[wire.Record],
    response: type[wire.Record],
    answer_header: type[wire.Record] | None,
) -> Any:
    """Opens a request-response service of slices."""
    builder = node.service_builder(iox2.ServiceName.new(name))
    builder = builder.request_response(iox2.Slice[structure(request)], iox2.Slice[structure(response)])
    builder = builder.request_header(structure(header))
    return _opened(builder if answer_header is None else builder.response_header(structure(answer_header)), name)


def subscriber(service: Any, depth: int, history: int) -> Belonging:
    """A queue of at most `depth` messages that begins with up to `history` old ones."""
    static = service.static_config
    depth = max(1, min(depth, static.subscriber_max_buffer_size))
    builder = service.subscriber_builder().buffer_size(depth)
    with _said("subscribe"):
        return Belonging(builder.history_request(min(history, static.history_size, depth)).create())


def receive(port: Belonging, stream: str, max_held: int) -> Any:
    """The next sample, or None. Raises TooManyHeld when the program holds `max_held` of them."""
    try:
        return port.native.receive()
    except iox2.ReceiveError as error:
        if "ExceedsMaxBorrows" not in str(error):
            raise TransportFailed(f"cannot read {stream!r}: {error}") from None
    # What is held by nothing but circles of references goes first.
    gc.collect()
    try:
        return port.native.receive()
    except iox2.ReceiveError:
        raise TooManyHeld(
            f"{max_held} messages of {stream!r} are held already: let go of one, or keep `frame.copy()` in its place"
        ) from None


class _Memory:
    """Bytes of a sample, for numpy; as long as an array looks at them, the sample is alive."""

    __slots__ = ("__array_interface__", "port", "sample")

    def __init__(self, sample: Any, port: Any, size: int) -> None:
        self.sample = Belonging(sample)
        # Without it the publisher would take the memory back.
        self.port = port
        # True: the pages are read-only, and numpy lets nobody say otherwise.
        memory = (sample.payload_ptr, True)
        self.__array_interface__ = {"version": 3, "shape": (size,), "typestr": "|u1", "data": memory}


def array(sample: Any, port: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The payload of a sample or response of `port` as a read-only array that owns both."""
    count = sample.header.number_of_elements
    if count == 0:
        # There may be no address.
        empty = np.empty(0, dtype)
        empty.flags.writeable = False
        return empty
    return np.asarray(_Memory(sample, port, count * dtype.itemsize)).view(dtype)


def payload(sample: Any, record: type[wire.Record]) -> bytes:
    """The elements of a sample or response, copied."""
    count = sample.header.number_of_elements
    # There may be no address.
    return ctypes.string_at(sample.payload_ptr, count * record.dtype.itemsize) if count else b""


def user_header(sample: Any, size: int) -> bytes:
    """The user header of a sample or response, copied."""
    return ctypes.string_at(sample.user_header_ptr, size)


def fixed(sample: Any, record: type[R]) -> R:
    """The payload of a sample of one element, copied."""
    return _read(sample.payload_ptr, record)


def header(sample: Any, record: type[R]) -> R:
    """The user header of a sample or response, copied."""
    return _read(sample.user_header_ptr, record)


def _read(address: int, record: type[R]) -> R:
    data = ctypes.string_at(address, record.dtype.itemsize)
    # Types are hashable, which mypy does not see of a type variable's.
    numbers = _numbers(record)  # type: ignore[arg-type]
    if numbers is not None:
        return record(*numbers.unpack(data))
    element: np.void = np.frombuffer(data, record.dtype)[0]
    return record.read(element)


@functools.cache
def _numbers(record: type[wire.Record]) -> struct.Struct | None:
    """The quicker way to read a wire type, for one that consists of numbers alone."""
    kinds = (record.dtype[name].kind for name in record.dtype.names or ())
    return packer(record) if all(kind in "iuf" for kind in kinds) else None


class Listener:
    """A listener that several threads may wait at: one listens for all, as iceoryx2 would let them wait one after the other."""

    def __init__(self, service: Any) -> None:
        """Raises TransportFailed when all places are taken."""
        with _said("listen"):
            self._port = Belonging(service.listener_builder().create())
        self._turn = Belonging(threading.Lock())
        self._woken = threading.Condition()
        self.wakes = 0
        """Number of times that somebody woke."""

    def wait(self, timeout: float, wakes: int) -> None:
        """Sleeps until an event comes, for at most `timeout` [s]; not at all when somebody woke since `wakes` was read."""
        turn = self._turn.native
        if turn.acquire(blocking=False):
            try:
                if self.wakes == wakes:
                    self._listen(timeout)
            finally:
                with self._woken:
                    self.wakes += 1
                    turn.release()
                    self._woken.notify_all()
        else:
            with self._woken:
                self._woken.wait_for(lambda: self.wakes != wakes, timeout)

    def _listen(self, timeout: float) -> None:
        # A socket takes a timeout that rounds to zero for "for ever".
        port = self._port.native
        if timeout < 1e-5:
            port.try_wait()
            return
        duration = _SHORT_WAIT if timeout == _SHORT_WAIT_S else iox2.Duration.from_secs_f64(timeout)
        with contextlib.suppress(iox2.ListenerWaitError):
            port.timed_wait(duration)


def notifier(service: Any) -> Belonging:
    """A port that wakes listeners. Raises TransportFailed when all places are taken."""
    with _said("wake the server"):
        return Belonging(service.notifier_builder().create())


def sender(service: Any, max_elements: int) -> Belonging:
    """A port for requests of up to `max_elements` elements, with all its memory set aside."""
    builder = service.client_builder().initial_max_slice_len(max_elements)
    with _said("send requests"):
        port = Belonging(builder.backpressure_strategy(iox2.BackpressureStrategy.DiscardData).create())
    # iceoryx2 only reserves addresses: without this, a full mount kills the process at its first write.
    for file in SHARED_MEMORY.glob(f"*_{port.id.value}.data"):
        with file.open("r+b") as segment:
            try:
                os.posix_fallocate(segment.fileno(), 0, os.fstat(segment.fileno()).st_size)
            except OSError as error:
                raise TransportFailed(f"shared memory is full: {error}") from None
    return port


def send(port: Belonging, count: int, elements: bytes, head: bytes) -> Belonging | None:
    """Sends a request of `count` elements and returns what waits for its answer, or None when nobody has room for it."""
    try:
        request = port.native.loan_slice_uninit(count)
        if count:
            ctypes.memmove(request.payload_ptr, elements, len(elements))
        ctypes.memmove(request.user_header_ptr, head, len(head))
        pending = request.assume_init().send()
    except (iox2.LoanError, iox2.RequestSendError) as error:
        if "ExceedsMaxActiveRequests" in str(error):
            return None
        raise TransportFailed(f"cannot send a request: {error}") from None
    return Belonging(pending) if pending.number_of_server_connections > 0 else None


def notify(notifier: Belonging) -> None:
    """Wakes the server; a request is seen without it, too."""
    with contextlib.suppress(iox2.NotifierNotifyError):
        notifier.native.notify_with_custom_event_id(_REQUEST)


def answer(pending: Belonging, listener: Listener, timeout: float) -> Any | None:
    """The response to a request; None when `timeout` [s] passes, or the server lets go of it, without one."""
    deadline = time.monotonic() + timeout
    native = pending.native
    while True:
        wakes = listener.wakes
        # Asked first: what the server sends before it lets go of the request is there when it has.
        is_open = native.is_connected
        response = native.receive()
        if response is not None:
            return response
        left = deadline - time.monotonic()
        if not is_open or left <= 0:
            return None
        listener.wait(min(left, _SHORT_WAIT_S), wakes)


@contextlib.contextmanager
def _said(what: str) -> Any:
    """Turns iceoryx2's words into a sentence with what they mean."""
    meanings = {
        "ExceedsMaxSupportedSubscribers": "all places for readers are taken: end a program that reads",
        "ExceedsMaxSupportedClients": "all places for senders of commands are taken: end a program that sends",
        "ExceedsMaxSupportedListeners": "all places for listeners are taken: end a program that reads",
        "ExceedsMaxSupportedNotifiers": "all places for notifiers are taken: end a program that sends",
    }
    try:
        yield
    except Exception as error:
        words = str(error)
        meaning = next((m for word, m in meanings.items() if word in words), words)
        raise TransportFailed(f"cannot {what}: {meaning}") from None
