"""The threads of a process share a session, and its waits have an end that they can rely on."""

import threading
import time
from collections.abc import Callable

from conftest import PATIENCE, Launch
from cosplat import CosplatError, LaunchedSession, Pause, Push, Resume, Step, Stop, wire


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
