"""Lock-step from Python: the server makes the steps that are asked for, and no others."""

import os
import subprocess
import threading
from pathlib import Path

import cosplat
import numpy as np
import pytest
from conftest import PATIENCE, SCENE, Launch
from cosplat import (
    BadName,
    Cause,
    ColliderVelocity,
    Force,
    LaunchedSession,
    Push,
    Refused,
    Reset,
    Restore,
    Save,
    SetGravity,
    Step,
    StepRefused,
)


def lockstep(launch: Launch, *names: str, scene: str = SCENE) -> LaunchedSession:
    """A server that waits for these participants from its first step on."""
    return cosplat.launch(scene, participants=names)


def test_a_step_is_published_before_it_is_answered(launch: Launch) -> None:
    with lockstep(launch, "robot") as session, session.participate("robot") as robot:
        frames, objects = session.frames(), session.objects(depth=64)
        assert robot.attached_at == 0
        for step in range(1, 20):
            done = robot.step()
            assert (done.step, done.frames, done.cause, done.acks) == (step, 1, Cause.COMPLETE, [])
            frame = frames.at(step)
            assert (frame.state_hash, frame.sim_time) == (done.state_hash, done.sim_time)
            assert objects.at(step).step == step
        done = robot.step(frames=30)
        assert (done.step, done.frames) == (49, 30)
        assert done.sim_time == pytest.approx(49 / 50)
        # Nothing happens in between.
        assert frames.at(49).state_hash == done.state_hash and frames.next(0.2) is None


def test_refusals_that_are_kept_take_no_place_of_requests(launch: Launch) -> None:
    kept = []
    bad = SetGravity((0, np.inf, 0))
    with lockstep(launch, "robot") as session, session.participate("robot") as robot:
        for count in range(1, 21):
            with pytest.raises(Refused) as error:
                robot.step(bad)
            kept.append(error)
            assert error.value.done and error.value.done.step == count
            with pytest.raises(Refused) as error:
                session.send(bad)
            kept.append(error)
        assert session.send(SetGravity((0, 0, 0)))[0].accepted and robot.step().step == 21


def test_a_push_is_that_of_a_script_bit_for_bit(launch: Launch, tmp_path: Path) -> None:
    script = tmp_path / "push.toml"
    script.write_text(
        "[[order]]\ntime = 0.1\naction = 'push'\nobject = 'left'\nimpulse = [0.3, 1.0, 0.1]\n\n[[order]]\naction = 'resume'\n"
    )
    with launch(paused=True, arguments=["--lossless"]) as session:
        frames = session.frames(64)
        subprocess.run([os.environ["COSPLAT"], "ctl", "--session", session.name, "script", str(script)], check=True)
        by_script = {}
        for frame in frames:
            by_script[frame.step] = frame.state_hash
            if frame.step == 60:
                break
    with lockstep(launch, "robot") as session, session.participate("robot") as robot:
        for step in range(1, 61):
            # The step that begins at 0.1 s is the sixth.
            done = robot.step(*([Push("left", (0.3, 1.0, 0.1))] if step == 6 else []))
            assert done.state_hash == by_script[step], f"step {step}"
    assert len(set(by_script.values())) == 61


def test_every_step_waits_for_all_participants(launch: Launch) -> None:
    with lockstep(launch, "a", "b") as session, session.participate("a") as a:
        done = a.step(timeout=0.2)
        assert (done.cause, done.step, done.frames) == (Cause.TIMEOUT, 0, 0) and done.reason == "waited for b"
        with cosplat.connect(session.name, timeout=PATIENCE) as other:
            b = other.participate("b")
            asked: list[int] = []
            thread = threading.Thread(target=lambda: asked.extend(b.step().step for _ in range(4)))
            thread.start()
            assert [a.step(Push("left", (0, 0.1, 0))).step, a.step(frames=3).step] == [1, 4]
            thread.join()
            assert asked == [1, 2, 3, 4]
            b.close()
            assert a.step().step == 5, "the others go on"


def test_steps_end_when_a_pair_touches(launch: Launch) -> None:
    with lockstep(launch, "robot") as session, session.participate("robot") as robot:
        contacts = session.contacts(depth=64)
        done = robot.step(frames=200, contact=("left", "floor"))
        assert (done.cause, done.contact) == (Cause.CONTACT, ("left", "floor"))
        # It falls 0.2 m, and touches within a cell of 0.05 m before that: after 0.17 to 0.21 s.
        assert 9 <= done.step <= 12
        message = contacts.at(done.step)
        assert "left" in [name for name, _ in message.pairs]
        entry = message.contacts[[name for name, _ in message.pairs].index("left")]
        assert entry["normal"] == pytest.approx([0, 1, 0], abs=1e-6) and entry["impulse"][1] > 0
        with pytest.raises(BadName, match="object 'ceiling' does not exist"):
            robot.step(contact=("left", "ceiling"))


def test_a_force_acts_for_one_step(launch: Launch) -> None:
    with lockstep(launch, "robot") as session, session.participate("robot") as robot:
        objects = session.objects(depth=64)
        robot.step(SetGravity((0, 0, 0)))
        before = objects.at(1)["left"]
        done = robot.step(Force("left", (3, 0, 0), torque=(0, 0, 0.1)))
        after = objects.at(done.step)["left"]
        # Momentum is force times the 20 ms of a step; the scene is held in 32 bits.
        gained = after.mass * (after.linear_velocity - before.linear_velocity)
        assert gained == pytest.approx([0.06, 0, 0], abs=1e-5)
        robot.step()
        later = objects.at(3)["left"]
        assert later.linear_velocity == pytest.approx(after.linear_velocity, abs=1e-5)
        with pytest.raises(ValueError, match="expected none together with a point"):
            robot.step(Force("left", (1, 0, 0), (1, 0, 0), point=(0, 0, 0)))


def test_a_snapshot_leads_to_the_same_bits_again(launch: Launch) -> None:
    with lockstep(launch, "planner") as session, session.participate("planner") as planner:
        planner.step(frames=5)
        planner.step(Save(3))
        first = [planner.step(Push("left", (0, 1, 0)) if i == 0 else Push("right", (1, 0, 0))).state_hash for i in range(10)]
        planner.step(Restore(3), frames=1)
        other = planner.step(Push("left", (0, 2, 0)))
        planner.step(Restore(3))
        assert other.state_hash not in first
        with pytest.raises(Refused, match="snapshot"):
            planner.step(Restore(4))


def test_a_refused_order_tells_what_was_done(launch: Launch) -> None:
    with lockstep(launch, "robot") as session, session.participate("robot") as robot:
        with pytest.raises(Refused, match="NaN") as error:
            robot.step(Push("left", (np.nan, 0, 0)), Push("right", (0, 1, 0)))
        assert error.value.done is not None and error.value.done.step == 1
        assert [ack.accepted for ack in error.value.acks] == [False, True]
        with pytest.raises(StepRefused, match="0"):
            robot.step(frames=0)
        with pytest.raises(BadName, match="is not a participant's name"):
            session.participate("a b")
        with pytest.raises(StepRefused, match="attached already"):
            session.participate("robot")


def test_only_a_server_in_lock_step_takes_part(launch: Launch) -> None:
    with launch(paused=True) as session, pytest.raises(StepRefused, match="lockstep"):
        session.participate("robot")


def test_a_paused_server_makes_single_steps(launch: Launch) -> None:
    with launch(paused=True) as session:
        frames = session.frames()
        [ack] = session.send(Step(3))
        assert ack.step == 3 and frames.at(3).step == 3
        assert frames.next(0.2) is None


def test_a_collider_moves_for_one_step(launch: Launch) -> None:
    with lockstep(launch, "robot") as session, session.participate("robot") as robot:
        objects = session.objects(depth=64)
        for _ in range(40):
            done = robot.step(ColliderVelocity("floor", (0, 1, 0)))
        # The floor met the block and carries it at its own speed.
        assert objects.at(done.step)["left"].linear_velocity[1] > 0.5


def test_a_reset_begins_anew(launch: Launch) -> None:
    with lockstep(launch, "robot") as session, session.participate("robot") as robot:
        first = [robot.step().state_hash for _ in range(5)]
        again = [robot.step(Reset()).state_hash] + [robot.step().state_hash for _ in range(4)]
        assert first == again
