"""The threads of a process share a session, and its waits have an end that they can rely on."""

import math
import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Any

import cosplat
import numpy as np
import pytest
from conftest import PATIENCE, SCENE, Launch
from cosplat import BadName, Cause, CosplatError, LaunchedSession, LaunchFailed, NoServer, Pause, Push, Resume, Step, Stop
from cosplat import remote, wire


def side_by_side(count: int, act: Callable[[int], None]) -> None:
    """Has threads act at the same time, and raises what the first of them raised."""
    errors: list[BaseException] = []
    begin = threading.Barrier(count)

    def run(number: int) -> None:
        try:
            begin.wait(PATIENCE)
            act(number)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=run, args=(number,)) for number in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(PATIENCE)
        assert not thread.is_alive()
    for error in errors:
        raise error


def test_orders_of_six_threads_all_arrive(session: LaunchedSession) -> None:
    journal = session.journal()
    numbers: list[int] = []

    def send(thread: int) -> None:
        for _ in range(30):
            acks = session.send(*[Push("left", (0, 0, 0))] * (1 + thread % 3))
            assert all(ack.accepted for ack in acks)
            numbers.extend(ack.sequence for ack in acks)
            assert session.status().step == 0 and session.scene().names == ["left", "right"]

    side_by_side(6, send)
    assert sorted(numbers) == list(range(1, 361))
    session.send(Resume())
    seen: list[wire.AppliedCommand] = []
    while len(seen) < 360:
        message = journal.next(PATIENCE)
        assert message
        seen += message.commands
    assert sorted(entry.command.sequence for entry in seen) == list(range(1, 361))


def test_a_thread_that_waits_for_its_answer_holds_nobody_up(session: LaunchedSession) -> None:
    ends: list[CosplatError] = []

    def step() -> None:
        try:
            session.send(Step(1_000_000), timeout=PATIENCE)
        except CosplatError as error:
            ends.append(error)

    stepping = threading.Thread(target=step)
    stepping.start()
    while session.status().step < 3:
        time.sleep(0.005)
    [ack] = session.send(Push("left", (0, 0, 0)))
    assert ack.accepted and 3 < ack.step < 1_000_000
    session.send(Stop())
    stepping.join(PATIENCE)
    # Its steps are never made.
    assert not stepping.is_alive() and len(ends) == 1


def test_each_message_goes_to_one_of_the_threads_that_read(launch: Launch) -> None:
    with launch(paused=True) as session:
        frames, changes = session.frames(64), session.changes(64)
        steps: list[int] = []

        def read(thread: int) -> None:
            if thread == 0:
                session.send(Resume(), Pause(at_step=51))
            while not steps or max(steps) < 50:
                frame = frames.next(0.05)
                if frame is not None:
                    steps.append(frame.step)
                told = changes.next(0)
                assert told is None or told.is_complete or told.header.since < told.step
                assert session.hello.pid == session.process.pid and not session.is_over(0)

        side_by_side(6, read)
        read(1)
        while (frame := frames.next(0)) is not None:
            steps.append(frame.step)
        # A paused server repeats the last one.
        assert sorted(set(steps)) == list(range(51)) and frames.missed == 0


def test_a_reader_that_is_closed_says_so_to_who_waits(session: LaunchedSession) -> None:
    reader = session.objects()
    words: list[str] = []

    def wait(thread: int) -> None:
        if thread == 0:
            time.sleep(0.05)
            reader.close()
            return
        try:
            while reader.next(PATIENCE) is not None:
                pass
        except ValueError as error:
            words.append(str(error))

    side_by_side(4, wait)
    assert words == ["the reader of 'objects' is closed"] * 3


WAITS: dict[str, Callable[[LaunchedSession, Any], object]] = {
    "connect": lambda session, timeout: cosplat.connect("nobody", timeout=timeout, domain=session.domain),
    "launch": lambda session, timeout: cosplat.launch(SCENE, program="/bin/false", timeout=timeout, domain=session.domain),
    "remote.connect": lambda session, timeout: remote.connect("127.0.0.1", 9, token="0" * 16, timeout=timeout, domain=session.domain),
    "Remote": lambda session, timeout: remote.Remote("127.0.0.1", 9, token="0" * 16, timeout=timeout),
    "scene": lambda session, timeout: session.scene(timeout),
    "status": lambda session, timeout: session.status(timeout),
    "send": lambda session, timeout: session.send(Pause(), timeout=timeout),
    "next": lambda session, timeout: session.journal().next(timeout),
    "next changes": lambda session, timeout: session.changes().next(timeout),
    "at": lambda session, timeout: session.frames().at(7, timeout),
}


@pytest.mark.parametrize("wait", WAITS)
def test_a_timeout_that_is_no_number_is_refused(session: LaunchedSession, wait: str) -> None:
    for none in (math.nan, -math.nan, np.float32("nan")):
        with pytest.raises(ValueError, match="the timeout is nan, expected a number of seconds"):
            WAITS[wait](session, none)
    for text in ("5", b"5", [1.0], 1j):
        with pytest.raises(TypeError, match="the timeout is .*, expected a number of seconds"):
            WAITS[wait](session, text)
    # A deadline that has passed.
    for past in (-1, -1e-9, -math.inf, -(10**400)):
        try:
            WAITS[wait](session, past)
        except (CosplatError, OSError) as error:
            assert not isinstance(error, BadName)


@pytest.mark.parametrize("wait", ["scene", "status", "send", "remote.connect", "Remote", "launch"])
def test_an_infinite_timeout_waits_for_what_comes(session: LaunchedSession, wait: str) -> None:
    for long in (math.inf, 1e300, 10**400, np.float64(math.inf)):
        try:
            WAITS[wait](session, long)
        except (NoServer, LaunchFailed):
            pass


def test_timeouts_of_steps_are_numbers(launch: Launch) -> None:
    with launch(participants=["a", "b"]) as session, session.participate("a") as a:
        for none, kind in ((math.nan, ValueError), ("5", TypeError)):
            with pytest.raises(kind, match="expected a number of seconds"):
                a.step(timeout=none)  # type: ignore[arg-type]
        assert a.step(timeout=-1).cause is Cause.TIMEOUT
        waits = a.submit(timeout=math.inf)
        with cosplat.connect(session.name, domain=session.domain) as other, other.participate("b") as b:
            b.step()
            assert waits.done().cause is Cause.COMPLETE
            waits = a.submit(timeout=1e300)
            b.step()
            assert waits.done().cause is Cause.COMPLETE


def test_an_endless_wait_for_an_answer_ends_with_the_server(session: LaunchedSession) -> None:
    session.send(Pause())
    os.kill(session.process.pid, signal.SIGSTOP)
    killer = threading.Timer(0.2, session.process.kill)
    killer.start()
    with pytest.raises(CosplatError):
        session.send(Push("left", (0, 0, 0)), timeout=math.inf)
    killer.join()
