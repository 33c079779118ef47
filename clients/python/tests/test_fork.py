"""What a process is attached to is its own: a forked child neither ends nor uses it, and attaches by itself."""

import pickle
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest
from conftest import PATIENCE, SCENE, Launch
from cosplat import Domain, LaunchedSession, Resume

PRELUDE = """
import gc, os, sys, threading, cosplat
from cosplat import OtherProcess, Pause, Push, Resume

name = sys.argv[1]

def in_child(act):
    child = os.fork()
    if child == 0:
        act()
        sys.exit(0)
    assert os.waitpid(child, 0)[1] == 0

def refused(use):
    try:
        use()
    except OtherProcess as error:
        assert "call `cosplat.connect` here, after the fork" in str(error), error
    else:
        raise AssertionError("it was used")
"""


def run(script: str, *arguments: str) -> list[str]:
    """Lines of a program with a session's name, whose children end as Python ends."""
    # From 3.12 on Python warns of forks beside threads, which numpy has.
    command = [sys.executable, "-W", "ignore::DeprecationWarning", "-c", PRELUDE + textwrap.dedent(script), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ""
    return done.stdout.splitlines()


@pytest.mark.parametrize(
    "act",
    [
        "pass",
        "os.fork()",
        "frames.close(); session.close()",
        "gc.collect()\n    session = frames = frame = objects = submitted = None\n    gc.collect()",
    ],
)
def test_a_child_that_ends_takes_nothing_from_its_parent(session: LaunchedSession, act: str) -> None:
    session.send(Resume())
    lines = run(
        f"""
session = cosplat.connect(name)
frames, objects = session.frames(), session.objects(64)
frame = frames.next(60)
submitted = session.send(Push("left", (0, 0, 0)))
def act():
    global session, frames, frame, objects, submitted
    {act}
in_child(act)
print(len([frames.next(60).step for _ in range(3)]), len([objects.next(60).step for _ in range(3)]))
print(session.send(Push("left", (0, 0, 0)))[0].accepted, session.status().step > 0, len(session.scene().names))
frames.close()
print(len([frame.step for frame, _ in zip(session.frames(), range(3))]))
""",
        session.name,
    )
    assert lines == ["3 3", "True True 2", "3"]


def test_a_frame_stays_when_a_child_that_has_it_ends(launch: Launch) -> None:
    with launch(paused=True, arguments=["--frame-slots", "4"]) as session:
        session.send(Resume())
        lines = run(
            """
            session = cosplat.connect(name)
            frames = session.frames(64)
            height = frames.next(60).positions[5:6, 1]
            then = height.copy()
            for _ in range(3):
                in_child(lambda: globals().pop("height"))
            last = frames.next(60).step + 100
            while frames.next(60).step < last:
                pass
            print(height == then, frames.next(60).positions[5, 1] != then)
            del height
            while frames.next(60).step < last + 100:
                pass
            """,
            session.name,
        )
        assert lines == ["[ True] [ True]"]
        assert session.process.poll() is None


def test_a_child_is_told_to_attach_by_itself(session: LaunchedSession) -> None:
    session.send(Resume())
    lines = run(
        """
        session = cosplat.connect(name)
        frames, loop = session.frames(), iter(session.frames())
        next(loop), session.scene(), session.status(), session.send(Pause()), session.send(Resume())

        def act():
            refused(lambda: frames.next(60))
            refused(lambda: frames.at(3))
            refused(lambda: next(loop))
            refused(lambda: session.hello)
            refused(lambda: session.scene())
            refused(lambda: session.status())
            refused(lambda: session.send(Pause()))
            refused(lambda: session.objects())
            refused(lambda: session.participate("robot"))
            session.close()
            with cosplat.connect(name) as own:
                reader = own.frames()
                print([reader.next(60) is not None for _ in range(3)], own.send(Resume())[0].accepted, flush=True)

        for _ in range(3):
            in_child(act)
        print(frames.next(60) is not None)
        """,
        session.name,
    )
    assert lines == ["[True, True, True] True"] * 3 + ["True"]
    # The program ended in order, and its children's sessions with them.
    while session.status().frame_readers != 0:
        time.sleep(0.01)


def test_a_pool_of_forked_processes_attaches_in_each(session: LaunchedSession) -> None:
    session.send(Resume())
    lines = run(
        """
        import multiprocessing
        session = cosplat.connect(name)
        frames = session.frames()

        def use(_):
            refused(lambda: frames.next(60))
            with cosplat.connect(name) as own:
                return own.frames().next(60) is not None

        with multiprocessing.get_context("fork").Pool(3) as pool:
            print(all(pool.map(use, range(9))))
        print(frames.next(60) is not None)
        """,
        session.name,
    )
    assert lines == ["True", "True"]


def test_a_daemon_attaches_when_its_parent_has_left(session: LaunchedSession) -> None:
    session.send(Resume())
    lines = run(
        """
        session = cosplat.connect(name)
        frames = session.frames()
        frame = frames.next(60)
        reading, writing = os.pipe()
        if os.fork():
            sys.exit(0)
        os.setsid()
        if os.fork():
            sys.exit(0)
        # It ends when both of them have left.
        os.close(writing)
        assert os.read(reading, 1) == b""
        refused(lambda: frames.next(60))
        with cosplat.connect(name) as own:
            print([own.frames().next(60) is not None for _ in range(3)], flush=True)
        """,
        session.name,
    )
    assert lines == ["[True, True, True]"]
    while session.status().frame_readers != 0:
        time.sleep(0.01)


def test_threads_of_the_parent_do_not_hang_the_child(session: LaunchedSession) -> None:
    lines = run(
        """
        session = cosplat.connect(name)
        frames = session.frames()
        stop = threading.Event()

        def read():
            while not stop.is_set():
                frames.next(0.05), session.status(), session.send(Pause())

        threads = [threading.Thread(target=read) for _ in range(4)]
        for thread in threads:
            thread.start()
        for _ in range(20):
            in_child(lambda: (refused(lambda: frames.next(60)), refused(lambda: session.send(Pause()))))
        stop.set()
        for thread in threads:
            thread.join()
        print(session.send(Pause())[0].accepted)
        """,
        session.name,
    )
    assert lines == ["True"]


def test_a_child_stops_no_server_that_its_parent_launched(launch: Launch) -> None:
    lines = run(
        """
        scene = sys.argv[1]
        with cosplat.launch(scene, participants=["robot"]) as session, session.participate("robot") as robot:
            robot.step()
            child = os.fork()
            if child == 0:
                refused(robot.step)
                # Leaves both contexts.
                sys.exit(0)
            assert os.waitpid(child, 0)[1] == 0
            print(robot.step().step, session.process.poll())
            submitted = robot.submit()
            in_child(lambda: (globals().pop("submitted"), gc.collect()))
            print(submitted.done().step)
        """,
        SCENE,
    )
    assert lines == ["2 None", "3"]


def test_what_is_attached_is_not_sent_to_other_processes(session: LaunchedSession, launch: Launch) -> None:
    reader = session.frames()
    frame = reader.next(PATIENCE)
    for attached in (session, reader):
        with pytest.raises(TypeError, match="cannot be sent to another process: call `cosplat.connect` there"):
            pickle.dumps(attached)
    # What was read can.
    again = pickle.loads(pickle.dumps(frame))
    assert frame and again.items.tobytes() == frame.items.tobytes()


def test_a_child_leaves_its_parents_environment_alone(launch: Launch) -> None:
    lines = run(
        """
        env = cosplat.Env(sys.argv[1], observe=["left"], forces={"left": 1.0}, reward=lambda objects, action: 0.0)
        env.reset(seed=1)
        in_child(lambda: (refused(lambda: env.step([0, 0, 0])), env.close()))
        print(env.step([0, 0, 0])[4]["cause"])
        env.close()
        """,
        SCENE,
    )
    assert lines == ["COMPLETE"]


def test_a_child_ends_no_simulation_of_its_parents_sweep(domain: Domain, tmp_path: Path) -> None:
    lines = run(
        """
        def metrics(report):
            in_child(lambda: None)
            return {"frames": report.summary["frames"]}

        rows = cosplat.sweep(sys.argv[1], {"dx": [0.05, 0.06, 0.07]}, duration=0.5, table=sys.argv[2], metrics=metrics, workers=3)
        print([row.metrics["frames"] for row in rows])
        """,
        SCENE,
        str(tmp_path / "table.jsonl"),
    )
    assert lines == ["[25, 25, 25]"]
