"""Lock-step: the server makes the steps that its participants ask for, and no others."""

from __future__ import annotations

import contextlib
import enum
import math
import os
import re
import struct
from typing import TYPE_CHECKING, NamedTuple, Self

from . import wire
from .errors import BadName, CosplatError, Malformed, Refused, StepRefused
from .orders import Ack, Order
from .packing import packer, text
from .requests import RequestPort, Sent
from .timeouts import seconds
from .wire import StepDone, StepRequest

if TYPE_CHECKING:
    from .scene import Scene
    from .session import Session


class Cause(enum.IntEnum):
    """Why a step request was answered."""

    COMPLETE = wire.RETURN_COMPLETE
    """All steps were made."""
    CONTACT = wire.RETURN_CONTACT
    """The pair touched in the last step."""
    EVENT = wire.RETURN_EVENT
    """Particles left, an object fell apart, the server paused itself, or the state was set back."""
    QUARANTINE = wire.RETURN_QUARANTINE
    """Particles were frozen because their state stayed bad."""
    TERMINATE = wire.RETURN_TERMINATE
    """The server ends, and no step follows."""
    TIMEOUT = wire.RETURN_TIMEOUT
    """The time was over; `reason` names who was waited for."""


_REQUEST = packer(StepRequest)
_DONE = packer(StepDone)
_CAUSES = frozenset(map(int, Cause))
_NO_CONDITION = (0, 0, 0, 0)


class Done(NamedTuple):
    """What came of a step request."""

    step: int
    """Steps completed by the server; the frame of this step was sent."""
    sim_time: float
    """Simulated time at the end of it [s]."""
    state_hash: int
    """Hash of the state after it."""
    frames: int
    """Steps made for this request."""
    cause: Cause
    """Why the answer came."""
    contact: tuple[str, str] | None
    """The pair that touched: an object, and an object or collider."""
    reason: str
    """A sentence for all causes but COMPLETE."""
    server_seconds: float
    """Wall time that the server spent on the steps, publishing included [s]."""
    acks: list[Ack]
    """Answers to the orders."""


class Participant:
    """Takes part in lock-step; made by `Session.participate`. Every step waits for it."""

    def __init__(self, session: Session, name: str) -> None:
        if not re.fullmatch(r"[A-Za-z0-9._-]{1,48}", name):
            raise BadName(f"{name!r} is not a participant's name: expected 1 to 48 of the characters a-z A-Z 0-9 - _ .")
        self.name = name
        """Name among the participants; it orders the commands of one step among theirs."""
        self._name = name.encode()
        self._session = session
        session.look_after()
        self._port: RequestPort | None = RequestPort(session, "step", StepRequest, StepDone)
        # The order among participants is the same in every run.
        self._client = _fnv1a(self._name)
        self.attached_at = self._asked(wire.STEP_ATTACH, 10.0).step
        """The last step that was made without it."""

    def step(
        self,
        *orders: Order,
        frames: int = 1,
        contact: tuple[str | int, str | int] | None = None,
        event: bool = False,
        quarantine: bool = False,
        timeout: float | None = None,
    ) -> Done:
        """Asks for `frames` steps, 1 to 1,000,000, with orders for the first of them, and returns when they are published.

        It returns earlier when at the end of a step the pair `contact` touches (an object, and an object or collider), at an
        `event`, when particles are frozen (`quarantine`), or after `timeout` [s]. Whoever reads frames or objects then finds
        `Done.step`: `reader.at(done.step)`. Orders of the request whose step was not made are then dropped.

        Raises Refused when an order is refused (the steps are made, and `error.done` tells), StepRefused when the request
        is, BadName for names that the scene does not have, ServerLost.
        """
        return self.submit(
            *orders, frames=frames, contact=contact, event=event, quarantine=quarantine, timeout=timeout
        ).done()

    def submit(
        self,
        *orders: Order,
        frames: int = 1,
        contact: tuple[str | int, str | int] | None = None,
        event: bool = False,
        quarantine: bool = False,
        timeout: float | None = None,
    ) -> Submitted:
        """Asks as `step` does and does not wait: who has several servers lets them step side by side.

        Raises BadName, ServerLost and TimedOut; what else `step` raises comes from `Submitted.done`.
        """
        until = _NO_CONDITION
        if contact is not None or event or quarantine:
            until = _until(self._session.scene() if contact else None, contact, event, quarantine)
        wait_ns = math.inf if timeout is None else 1e9 * seconds(timeout)
        # None is 0 on the wire.
        timeout_ns = max(1, round(wait_ns)) if wait_ns < 2**64 else 0
        return Submitted(self._session, *self._ask(wire.STEP_ADVANCE, orders, None, frames, until, timeout_ns), None)

    def close(self) -> None:
        """Takes part no more; the others go on."""
        if self._port is not None:
            # A server that is gone waits for nobody.
            with contextlib.suppress(CosplatError, ValueError):
                self._asked(wire.STEP_DETACH, 2.0)
        self._port = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _asked(self, kind: int, timeout: float) -> Done:
        return Submitted(self._session, *self._ask(kind, (), timeout), timeout).done()

    def _ask(
        self,
        kind: int,
        orders: tuple[Order, ...],
        timeout: float | None,
        frames: int = 0,
        until: tuple[int, int, int, int] = _NO_CONDITION,
        timeout_ns: int = 0,
    ) -> tuple[RequestPort, Sent]:
        if self._port is None:
            raise ValueError(f"the participant {self.name!r} is closed")
        try:
            head = _REQUEST.pack(self._client, os.getpid(), len(orders), kind, frames, *until, timeout_ns, self._name)
        except struct.error as error:
            raise ValueError(f"{frames} steps cannot be asked for: {error}") from None
        # It takes part with one server: the next one knows nothing of it.
        return self._port, self._port.submit(orders, head, timeout, awaits_server=kind == wire.STEP_ATTACH)


class Submitted:
    """A request for steps on its way; made by `Participant.submit`. Dropped, its answer is lost."""

    __slots__ = ("_port", "_sent", "_session", "_timeout")

    def __init__(self, session: Session, port: RequestPort, sent: Sent, timeout: float | None) -> None:
        self._session, self._port, self._sent, self._timeout = session, port, sent, timeout

    def done(self) -> Done:
        """Waits until the steps are made and published. Raises Refused, StepRefused, ServerLost, Malformed."""
        header, acks = self._port.answer(self._sent, self._timeout)
        answer = _DONE.unpack(header)
        step, sim_time, _, state_hash, step_ns, made, cause, _, contact_kind, first, second, reason = answer
        if cause == wire.RETURN_REFUSED:
            raise StepRefused(text(reason))
        pair = None
        if cause == wire.RETURN_CONTACT:
            scene = self._session.scene()
            others = scene.names if contact_kind == wire.CONTACT_OBJECT else scene.colliders
            if first >= len(scene.names) or second >= len(others):
                raise Malformed(f"the answer tells of a contact of {first} and {second}, which the scene does not have")
            pair = (scene.names[first], others[second])
        if cause not in _CAUSES:
            raise Malformed(f"the answer has the cause {cause}, expected one of {sorted(_CAUSES)}")
        done = Done(step, sim_time, state_hash, made, Cause(cause), pair, text(reason), step_ns * 1e-9, acks)
        if not all(ack.accepted for ack in acks):
            raise Refused(acks, done)
        return done


def _until(
    scene: Scene | None, contact: tuple[str | int, str | int] | None, event: bool, quarantine: bool
) -> tuple[int, int, int, int]:
    """What ends a request early: flags, kind of a pair, and the pair."""
    kind = first = second = 0
    if scene is not None and contact is not None:
        second, kind = _object_or_collider(scene, contact[1])
        first = scene.object_id(contact[0])
    conditions = (contact is not None, wire.UNTIL_CONTACT), (event, wire.UNTIL_EVENT), (quarantine, wire.UNTIL_QUARANTINE)
    return sum(flag for wanted, flag in conditions if wanted), kind, first, second


def _object_or_collider(scene: Scene, name: str | int) -> tuple[int, int]:
    """Id and kind of what an object can touch; numbers are ids of objects."""
    if isinstance(name, str) and name not in scene.names and name in scene.colliders:
        return scene.colliders.index(name), wire.CONTACT_COLLIDER
    return scene.object_id(name), wire.CONTACT_OBJECT


def _fnv1a(data: bytes) -> int:
    state = 0xCBF29CE484222325
    for byte in data:
        state = (state ^ byte) * 0x100000001B3 % 2**64
    return state
