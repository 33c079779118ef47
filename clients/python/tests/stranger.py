"""A server that is none: it says and publishes what a story wants."""

import ctypes
import threading
import time
from types import TracebackType
from typing import Any, Self

import iceoryx2 as iox2
import numpy as np
from cosplat import Domain, transport, wire


def hello(**other: int) -> wire.Hello:
    """The greeting of a server of this package's version, but for `other`."""
    fields = {"wire_version": wire.WIRE_VERSION, "schema_hash": wire.SCHEMA_HASH, "pid": 4711, "epoch": 5, "recorded_first": 0, "recorded_last": 0}
    return wire.Hello(**{**fields, **other}, server_version=b"9.9.9")


class Stranger:
    """Serves `session` with a hello and a stream of frames, and nothing else."""

    def __init__(self, domain: Domain, session: str, greeting: wire.Hello | None) -> None:
        self._node = domain.join("stranger")
        self._session = session
        self._greeting = greeting
        self._end = threading.Event()
        self._frames = self._service("v1/frame", wire.GaussianState, wire.FrameHeader)
        self._status = self._service("v1/status", wire.Status, None)
        self._events = [self._builder(f"v1/{stream}").event().open_or_create() for stream in ("frame", "command")]
        self._frame = self._frames.publisher_builder().initial_max_slice_len(16).create()
        self._thread = threading.Thread(target=self._greet) if greeting else None

    def __enter__(self) -> Self:
        if self._thread:
            self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._end.set()
        if self._thread:
            self._thread.join()

    def publish(self, *, step: int, elements: int, count: int | None = None, epoch: int = 5) -> None:
        """Sends a frame of `elements` Gaussians whose header announces `count`."""
        header = np.zeros((), wire.FrameHeader.dtype)
        header["step"], header["epoch"] = step, epoch
        header["count"] = elements if count is None else count
        sample = self._frame.loan_slice_uninit(elements)
        ctypes.memmove(sample.user_header_ptr, header.ctypes.data, header.nbytes)
        ctypes.memset(sample.payload_ptr, 0, 64 * elements)
        sample.assume_init().send()

    def _builder(self, name: str) -> Any:
        return self._node.service_builder(iox2.ServiceName.new(f"cosplat/{self._session}/{name}"))

    def _service(self, name: str, payload: type[wire.Record], header: type[wire.Record] | None) -> Any:
        builder = self._builder(name).publish_subscribe(iox2.Slice[transport.structure(payload)])
        if header:
            builder = builder.user_header(transport.structure(header))
        return builder.history_size(1).subscriber_max_buffer_size(64).subscriber_max_borrowed_samples(8).open_or_create()

    def _greet(self) -> None:
        assert self._greeting
        values = np.zeros((), wire.Hello.dtype)
        for name in wire.Hello.dtype.names or ():
            values[name] = getattr(self._greeting, name)
        structure = transport.structure(wire.Hello)
        service = self._builder("hello").publish_subscribe(structure).history_size(1).create()
        publisher = service.publisher_builder().create()
        publisher.send_copy(structure.from_buffer_copy(values.tobytes()))
        # Whoever serves has to look after late joiners.
        while not self._end.is_set():
            publisher.update_connections()
            time.sleep(0.005)
