"""What comes with every step: frames, objects, the journal."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Generic, Self, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from . import transport, wire
from .errors import BadName, Malformed, ServerLost, TimedOut
from .timeouts import seconds
from .wire import ChangesHeader, ContactsHeader, FrameHeader, GaussianState, JournalHeader, ObjectChange
from .wire import ObjectsHeader, ObjectState

if TYPE_CHECKING:
    from .session import Session

Names: TypeAlias = tuple[list[str], list[str]]
"""Names of objects, by id, and of colliders, by number."""

Header: TypeAlias = FrameHeader | ChangesHeader | ObjectsHeader | JournalHeader | ContactsHeader
"""What heads a message."""

H = TypeVar("H", bound=Header)


class Message(Generic[H]):
    """A message of the server."""

    def __init__(self, header: H, items: NDArray[np.void], missed: int, is_new_run: bool, names: Names) -> None:
        self.header = header
        """The header."""
        self.items = items
        """The elements, a structured array."""
        self.missed = missed
        """Steps (of the journal: commands) between the message read before and this one."""
        self.is_new_run = is_new_run
        """Whether this is the first message after the server was started anew: read the scene again."""
        self._names = names

    @property
    def step(self) -> int:
        """Step count."""
        return self.header.step

    @property
    def epoch(self) -> int:
        """Identifies the server's run."""
        return self.header.epoch

    def __len__(self) -> int:
        return len(self.items)


class Frame(Message[FrameHeader]):
    """Every Gaussian after a step, read where the server wrote it. Arrays are views of shape (Gaussians, ...).

    They cannot be written, and each of them keeps the memory from reuse. Of the frames of one reader a program can hold
    8; whoever wants more keeps `copy()`.
    """

    @property
    def sim_time(self) -> float:
        """Simulated time at the end of the step [s]."""
        return self.header.sim_time

    @property
    def state_hash(self) -> int:
        """Hash of the complete simulation state."""
        return self.header.state_hash

    def copy(self) -> Frame:
        """The same in memory of one's own, which may be written."""
        return Frame(self.header, self.items.copy(), self.missed, self.is_new_run, self._names)

    @property
    def is_reset(self) -> bool:
        """Whether the state was set back to the initial one in this step."""
        return bool(self.header.flags & wire.FRAME_FLAG_RESET)

    @property
    def is_paused(self) -> bool:
        """Whether the server was paused when it sent this frame."""
        return bool(self.header.flags & wire.FRAME_FLAG_PAUSED)

    @property
    def is_last(self) -> bool:
        """Whether this is the last frame of the session."""
        return bool(self.header.flags & wire.FRAME_FLAG_LAST)

    @property
    def gaussians(self) -> NDArray[np.void]:
        """All fields, of `wire.GaussianState.dtype`."""
        return self.items

    @property
    def positions(self) -> NDArray[np.float32]:
        """Centres [m], world frame, (n, 3)."""
        return self._field("position")

    @property
    def colors(self) -> NDArray[np.uint8]:
        """Base colour and opacity, RGBA, 0 to 255, not premultiplied, (n, 4)."""
        return self._field("color")

    @property
    def covariances(self) -> NDArray[np.float32]:
        """Covariance xx xy xz yy yz zz [m^2], world frame, (n, 6)."""
        return self._field("covariance")

    @property
    def rotations(self) -> NDArray[np.float32]:
        """World-from-asset rotations, unit quaternions xyzw, (n, 4)."""
        return self._field("rotation")

    @property
    def object_ids(self) -> NDArray[np.uint32]:
        """Object of each Gaussian, (n,)."""
        return self._field("object")

    @property
    def indices(self) -> NDArray[np.uint32]:
        """Index of each Gaussian in the scene's arrays, (n,)."""
        return self._field("index")

    def _field(self, name: str) -> NDArray[Any]:
        field: NDArray[Any] = self.items[name]
        return field


class Changes(Message[ChangesHeader]):
    """What moved in a step. `Assembly.apply` makes the frame of it."""

    @property
    def is_complete(self) -> bool:
        """Whether it holds the whole frame; else it builds on the message of the step `header.since`."""
        return self.header.since == self.header.step

    @property
    def is_last(self) -> bool:
        """Whether this is the last message of the session."""
        return bool(self.header.flags & wire.FRAME_FLAG_LAST)

    @property
    def sim_time(self) -> float:
        """Simulated time at the end of the step [s]."""
        return self.header.sim_time

    @property
    def state_hash(self) -> int:
        """Hash of the complete simulation state."""
        return self.header.state_hash

    @property
    def rows(self) -> NDArray[np.void]:
        """How objects have changed, of `wire.ObjectChange.dtype`. Raises Malformed for more rows than the message holds."""
        size = self.header.objects * ObjectChange.dtype.itemsize
        if size > self.items.nbytes:
            raise Malformed(f"a message on 'changes' of {len(self.items)} slots announces {self.header.objects} rows")
        rows: NDArray[np.void] = self.items.view(np.uint8)[:size].view(ObjectChange.dtype)
        return rows

    def gaussians_of(self, row: np.void) -> NDArray[np.void]:
        """The Gaussians that follow a row, of `wire.GaussianState.dtype`. Raises Malformed for places beyond the message."""
        first, count = int(row["slot"]), int(row["count"])
        if first + count > len(self.items):
            raise Malformed(f"{count} Gaussians from slot {first} on do not fit a message of {len(self.items)} slots")
        slots: NDArray[np.void] = self.items.view(GaussianState.dtype)
        return slots[first : first + count]


class Objects(Message[ObjectsHeader]):
    """The state of every object after a step; `objects["vase"]` is one of them."""

    @property
    def sim_time(self) -> float:
        """Simulated time at the end of the step [s]."""
        return self.header.sim_time

    @property
    def states(self) -> NDArray[np.void]:
        """All objects, of `wire.ObjectState.dtype`, in the order of their ids."""
        return self.items

    def __getitem__(self, object: str | int) -> ObjectState:
        """One object by name or id. Raises BadName when there is none."""
        number = find(self._names[0], object, "object")
        element: np.void = self.items[number]
        return ObjectState.read(element)


class Contacts(Message[ContactsHeader]):
    """Who touched whom during a step."""

    @property
    def contacts(self) -> NDArray[np.void]:
        """All contacts, of `wire.Contact.dtype`."""
        return self.items

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Names of who touched: an object, and an object or collider. Raises Malformed for what the scene does not have."""
        objects, colliders = self._names
        others = {wire.CONTACT_OBJECT: objects, wire.CONTACT_COLLIDER: colliders}
        try:
            return [(objects[c["object"]], others[int(c["kind"])][c["other"]]) for c in self.items]
        except (IndexError, KeyError) as error:
            raise Malformed(f"a contact names what the scene does not have: {error}") from None


class Journal(Message[JournalHeader]):
    """Commands that took effect at the start of a step."""

    @property
    def commands(self) -> list[wire.AppliedCommand]:
        """The commands, in the order of application."""
        return [wire.AppliedCommand.read(entry) for entry in self.items]


def find(names: list[str], wanted: str | int, what: str) -> int:
    """Index of a name, or of a number that is an index. Raises BadName with the names that there are."""
    if isinstance(wanted, str):
        if wanted in names:
            return names.index(wanted)
    elif 0 <= wanted < len(names):
        return int(wanted)
    raise BadName(f"{what} {wanted!r} does not exist: the scene has {', '.join(names) or 'none'}")


M = TypeVar("M", bound=Message[Any])


class Reader(Generic[M]):
    """A queue of messages. `for` loops over it end with the session.

    `next` stays attached when the server goes, and carries on with the next one.
    """

    def __init__(self, session: Session, stream: str, kind: type[M], types: tuple[type[Any], type[Any]], depth: int):
        self._session = session
        self._stream = stream
        self._kind = kind
        self._element, self._header = types
        service = session.open(lambda node, name: transport.pub_sub(node, name, *types), stream)
        self._max_held: int = service.static_config.subscriber_max_borrowed_samples
        self._service, self._depth = service, depth
        self._port: Any = transport.subscriber(service, depth, depth)
        self._listener: transport.Listener | None = None
        # Several threads may read: each message goes to one of them.
        self._lock = transport.Belonging(threading.RLock())
        self._believed: int | None = None
        self._next_number = 0
        self.epoch = 0
        """Run of the server that was read last."""
        self.missed = 0
        """Steps (of the journal: commands) missed since this reader was made."""

    def next(self, timeout: float | None = None) -> M | None:
        """The next message; None when `timeout` [s] passes without one. Without a timeout it waits as long as it takes.

        Raises TooManyHeld when the program holds as many messages as it may, and Malformed for one that contradicts
        itself.
        """
        deadline = None if timeout is None else time.monotonic() + seconds(timeout)
        while True:
            wakes = 0 if self._listener is None else self._listener.wakes
            with self._lock.native:
                if self._port is None:
                    raise ValueError(f"the reader of {self._stream!r} is closed")
                message = self._take()
            if message is not None:
                return message
            left = transport.LONGEST_WAIT if deadline is None else deadline - time.monotonic()
            if left <= 0:
                return None
            self._sleep(min(left, transport.LONGEST_WAIT), wakes)

    def at(self, step: int, timeout: float = 5.0) -> M:
        """The message of a step, waiting up to `timeout` [s] for it; older ones are passed over.

        Raises TimedOut when it does not come, or a later one did before.
        """
        timeout = seconds(timeout)
        deadline = time.monotonic() + timeout
        while (message := self.next(deadline - time.monotonic())) is not None:
            if message.step == step:
                return message
            if message.step > step:
                raise TimedOut(f"step {step} of {self._stream!r} is past: the next message is that of step {message.step}")
        raise TimedOut(f"step {step} of {self._stream!r} did not come within {timeout:.1f} s")

    def __iter__(self) -> Iterator[M]:
        """Messages up to the end of the session. Raises ServerLost when the server dies before."""
        while True:
            message = self.next(0.1)
            if message is None:
                if self._session.is_over(self.epoch):
                    return
                continue
            is_last = isinstance(message, Frame | Changes) and message.is_last
            yield message
            # While the next one comes, the caller alone decides what is held.
            del message
            if is_last:
                return

    def close(self) -> None:
        """Gives the place back to the server, when the last frame goes that is held. Frames stay as they are."""
        self._port = self._listener = self._service = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _sleep(self, seconds: float, wakes: int) -> None:
        listener = self._listener
        if listener is not None:
            listener.wait(seconds, wakes)
            return
        # A reader that only looks costs the server no wake-ups. What was sent until now made no event: look again first.
        with self._lock.native:
            if self._port is not None and self._listener is None:
                self._listener = transport.Listener(self._session.open(transport.event, "frame"))

    def _take(self) -> M | None:
        """The next message that is there."""
        while (sample := transport.receive(self._port, self._stream, self._max_held)) is not None:
            message = self._accept(sample)
            # In the next turn it would be a second one that is held.
            del sample
            if message is not None:
                return message
        return None

    def _accept(self, sample: Any) -> M | None:
        """Checks a message and counts what is missing before it; None for what is old or not the server's."""
        node = sample.header.node_id.value
        if node != self._believed:
            if not self._session.serves(node):
                return None
            self._believed = node
        header = transport.header(sample, self._header)
        items = transport.array(sample, self._port, self._element.dtype)
        if self._kind is not Frame:
            # They are small, and the server has room for few that are held.
            items = items.copy()
        if header.count != len(items):
            raise Malformed(f"a message on {self._stream!r} announces {header.count} elements and holds {len(items)}")
        if header.epoch < self.epoch:
            return None
        number, following = _numbers(header)
        is_first = self.epoch == 0
        is_new_run = header.epoch > self.epoch
        missed = 0 if is_new_run else max(0, number - self._next_number)
        self.missed += missed
        self.epoch = header.epoch
        self._next_number = following
        names: Names = self._session.names(self.epoch) if self._kind in (Objects, Contacts) else ([], [])
        return self._kind(header, items, missed, is_new_run and not is_first, names)


class ChangesReader(Reader[Changes]):
    """A queue of what moved. Whatever it hands out is complete or builds on the message before; where messages are missing it
    joins the stream anew, and the server sends a complete one."""

    def __init__(self, session: Session, depth: int):
        super().__init__(session, "changes", Changes, (wire.ChangeSlot, ChangesHeader), depth)
        self._last: tuple[int, int] | None = None
        # The server may join a reader in the middle of a message.
        self._may_pass = 1

    def _take(self) -> Changes | None:
        while (message := super()._take()) is not None:
            header = message.header
            if message.is_complete or self._last == (header.epoch, header.since):
                self._last, self._may_pass = (header.epoch, header.step), 0
                return message
            self._last = None
            if self._may_pass == 0:
                self._port = transport.subscriber(self._service, self._depth, self._depth)
            self._may_pass = 1 - self._may_pass
        return None


def _numbers(header: Header) -> tuple[int, int]:
    """The number that a message has in its run, and the number that the next one has."""
    if isinstance(header, JournalHeader):
        return header.first, header.first + header.count
    return header.step, header.step + 1


def lost(session: str, seconds: float) -> ServerLost:
    """The error of a server that is silent."""
    return ServerLost(f"the server of session {session!r} gave no sign of life for {seconds:.1f} s")
