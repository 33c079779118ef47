"""Stories of a session: what is read, what is ordered, and what happens when the server goes."""

import time

import cosplat
import numpy as np
import pytest
from conftest import PATIENCE, SCENE, Launch
from cosplat import (
    BadName,
    Checkpoint,
    Domain,
    LaunchedSession,
    Malformed,
    MoveCollider,
    Pause,
    Pin,
    Push,
    Refused,
    Drag,
    Grab,
    LetGo,
    Release,
    Remove,
    Reset,
    Resume,
    ServerLost,
    SetGravity,
    SetMaterial,
    SetPose,
    SetVelocity,
    Step,
    wire,
)
from stranger import Stranger, hello


def test_a_loop_sees_every_step_and_ends_with_the_session(launch: Launch) -> None:
    with launch(paused=True, arguments=["--duration", "1"]) as session:
        reader = session.frames(64)
        session.send(Resume())
        frames = [(frame.step, frame.is_last, frame.is_new_run) for frame in reader]
        # The last frame is sent once more when the server ends between two steps.
        assert [step for step, _, _ in frames[:51]] == list(range(51))
        assert frames[-1] == (50, True, False) and reader.missed == 0


def test_a_server_is_given_values_of_its_scene(launch: Launch) -> None:
    with launch(parameters={"gravity": (0.0, 0.0, 0.0), "objects.0.name": "west"}) as session:
        states = next(message for message in session.objects() if message.step > 1)
        assert states["west"].linear_velocity.tolist() == [0, 0, 0]
    with pytest.raises(cosplat.LaunchFailed, match="objects.9.name"):
        launch(parameters={"objects.9.name": "east"})


def test_changes_add_up_to_the_frame_bit_for_bit(domain: Domain) -> None:
    # A body falls beside matter, and both come to rest: rows of every kind, and none.
    scene = SCENE.replace('material = "soft_rubber"', 'material = "rigid"', 1)
    with cosplat.launch(scene, pace="free", paused=True, domain=domain) as session:
        frames, changes, assembly = session.frames(64), session.changes(), cosplat.Assembly()
        assert session.status().has_changes == 1
        session.send(Resume(), Pause(at_step=6))
        kinds: set[int] = set()
        for target in (5, 60, 100):
            while (told := changes.next(PATIENCE)) is not None:
                assembly.apply(told)
                kinds |= set(told.rows["kind"].tolist())
                frame = frames.at(told.step, PATIENCE)
                assert assembly.gaussians.tobytes() == frame.gaussians.tobytes(), told.step
                assert (told.state_hash, told.sim_time) == (frame.state_hash, frame.sim_time)
                if told.step >= target:
                    break
            if target < 100:
                session.send(Resume(), Pause(at_step=61 if target == 5 else 101))
        assert kinds == {wire.CHANGE_PLACED, wire.CHANGE_GAUSSIANS, wire.CHANGE_FORM}
        assert changes.missed == 0


def test_a_reader_of_changes_that_missed_some_gets_all_of_it_again(launch: Launch) -> None:
    with launch(paused=True) as session:
        changes, assembly = session.changes(2), cosplat.Assembly()
        session.send(Step(1))
        first = changes.next(PATIENCE)
        assert first and first.is_complete
        session.send(Resume(), Pause(at_step=41))
        while session.status().step < 40:
            time.sleep(0.01)
        session.send(Resume())
        seen = 0
        while seen < 5:
            told = changes.next(PATIENCE)
            assert told
            assembly.apply(told)
            seen += told.step > 40
        assert changes.missed > 0
        session.send(Pause())
        while (told := changes.next(0.5)) is not None:
            assembly.apply(told)
        session.send(Step(2))
        skipped, later = changes.next(PATIENCE), changes.next(PATIENCE)
        assert skipped and later and not later.is_complete
        with pytest.raises(Malformed, match=f"changes of step {later.step} build on step {skipped.step}"):
            assembly.apply(later)


def test_positions_and_objects_of_a_step_agree(launch: Launch) -> None:
    with launch(paused=True) as session:
        frames, objects = session.frames(64), session.objects(64)
        session.send(Resume())
        for _ in range(20):
            frame, states = frames.next(PATIENCE), objects.next(PATIENCE)
            assert frame and states and frame.step == states.step and frame.sim_time == states.sim_time
            left = states["left"]
            assert left.id == states[0].id == 0
            mean = frame.positions[frame.object_ids == left.id].mean(axis=0)
            # Gaussians cover the surface of the box evenly, so their mean is near its centre of mass.
            assert np.allclose(mean, left.com, atol=0.01)
        assert states and np.array_equal(states.states["com"][1], states["right"].com)
        with pytest.raises(BadName, match="object 'middle' does not exist: the scene has left, right"):
            states["middle"]


def test_the_scene_is_that_of_the_file(session: LaunchedSession) -> None:
    scene = session.scene()
    assert (scene.names, scene.colliders) == (["left", "right"], ["floor"])
    assert scene.header.frame_rate == 50.0
    assert 'name = "two blocks"' in scene.source
    part = scene.gaussians_of("right")
    assert (scene.gaussians["object"][part] == 1).all() and (scene.gaussians["object"] == 1).sum() == part.stop - part.start
    frame = session.frames().next(PATIENCE)
    assert frame and np.allclose(scene.gaussians["position"][frame.indices], frame.positions, atol=1e-6)


def test_status_tells_how_it_goes(session: LaunchedSession) -> None:
    status = session.status()
    assert (status.step, status.server_state) == (0, wire.SERVER_PAUSED)
    session.send(Resume())
    while (status := session.status()).step < 5:
        time.sleep(0.01)
    assert status.server_state == wire.SERVER_RUNNING and status.kinetic_energy > 0


def test_orders_are_applied_and_journalled(session: LaunchedSession) -> None:
    journal, objects = session.journal(), session.objects(64)
    orders = [
        Push("left", (0, 1, 0)),
        Push("left", (0, 1, 0), point=(-0.3, 0.3, 0), radius=0.1),
        SetVelocity("right", (1, 0, 0), angular=(0, 0, 1)),
        SetMaterial("right", "von_mises", 1e5, 0.3, {"yield_stress_pa": 1e3, "hardening_pa": 0}),
        SetGravity((0, 0, 0)),
        MoveCollider("floor", (0, -1, 0)),
        Pin("left", (-0.3, 0.3, 0), 0.05, at_step=4),
        Release("left", at_step=6),
        Grab("left", (-0.3, 0.3, 0), (-0.3, 0.35, 0), at_step=7),
        Drag("left", (-0.3, 0.36, 0), at_step=8),
        LetGo("left", at_step=9),
    ]
    acks = session.send(*orders, Pause(at_step=10), Resume())
    assert [ack.step for ack in acks] == [1, 1, 1, 1, 1, 1, 4, 6, 7, 8, 9, 10, 1]
    seen: list[tuple[int, wire.Command]] = []
    while len(seen) < len(orders):
        message = journal.next(PATIENCE)
        assert message
        seen += [(entry.step, entry.command) for entry in message.commands]
    assert [step for step, _ in seen] == [1, 1, 1, 1, 1, 1, 4, 6, 7, 8, 9]
    assert [command.sequence for _, command in seen] == list(range(1, 12))
    assert seen[3][1].material.parameters.tolist() == [1e3, 0, 0, 0]
    states = next(message for message in objects if message.step == 2)
    # A push of 1 N s twice on 8.56 kg; a velocity is what was ordered.
    assert states["left"].linear_velocity[1] > 0.2
    assert states["right"].linear_velocity == pytest.approx([1, 0, 0], abs=1e-3)


def test_status_says_what_hands_and_edits_brought_in(session: LaunchedSession) -> None:
    def status_of(step: int) -> wire.Status:
        while (status := session.status()).step < step:
            time.sleep(0.01)
        return status

    # A hand lifts a block by 0.1 m against 10 m/s^2, and holds it there.
    objects = session.objects(128)
    orders = [SetGravity((0, -10, 0)), Grab("left", (-0.3, 0.3, 0), radius=0.4)]
    lifts = [Drag("left", (-0.3, 0.3 + 0.004 * n, 0), at_step=1 + 2 * n) for n in range(1, 26)]
    session.send(*orders, *lifts, Pause(at_step=101), Resume())
    held = status_of(100)
    state = objects.next(PATIENCE)
    assert state
    masses = {name: state[name].mass for name in ("left", "right")}
    # It hangs g / w^2 below, 0.01 m, and what it is deformed by its weight is little.
    assert held.spring_work == pytest.approx(masses["left"] * 10 * 0.09, rel=0.1)
    assert (held.edit_energy, held.edit_mass) == (0, 0)
    # 1 m higher, and the other one is gone.
    session.send(SetPose("left", (-0.3, 1.39, 0)), Remove("right"), Step(1))
    edited = status_of(101)
    gone = held.potential_energy - edited.potential_energy + masses["left"] * 10
    assert edited.edit_mass == pytest.approx(-masses["right"])
    assert edited.edit_energy == pytest.approx(masses["left"] * 10 - gone, rel=0.05)
    assert edited.spring_work == held.spring_work


def test_orders_of_one_step_go_by_the_senders_numbers(session: LaunchedSession) -> None:
    journal = session.journal()
    with cosplat.connect(session.name, client=2) as late, cosplat.connect(session.name, client=1) as early:
        late.send(SetVelocity("left", (2, 0, 0)))
        early.send(SetVelocity("left", (1, 0, 0)))
        session.send(Resume())
        message = journal.next(PATIENCE)
    assert message and [(entry.client, entry.command.vector[0]) for entry in message.commands] == [(1, 1.0), (2, 2.0)]


def test_a_refusal_says_why_and_what_was_accepted(session: LaunchedSession) -> None:
    with pytest.raises(Refused, match="impulse is NaN, expected a finite number") as error:
        session.send(Push("left", (0, 1, 0)), Push(1, (np.nan, 0, 0)), Pause())
    assert [ack.accepted for ack in error.value.acks] == [True, False, True]
    with pytest.raises(BadName, match="object 'middle' does not exist: the scene has left, right"):
        session.send(Push("middle", (0, 1, 0)))
    with pytest.raises(BadName, match="object 2 does not exist"):
        session.send(Push(2, (0, 1, 0)))
    with pytest.raises(BadName, match="collider 'left' does not exist: the scene has floor"):
        session.send(MoveCollider("left", (0, 1, 0)))
    with pytest.raises(BadName, match="law 'steel' does not exist"):
        session.send(SetMaterial("left", "steel"))
    with pytest.raises(BadName, match=r"has the parameters \['yield_stress_pa', 'softening'\], found \['softening'\]"):
        session.send(SetMaterial("left", "plasticine", 1.0, 0.3, {"softening": 1.0}))
    with pytest.raises(ValueError, match=r"impulse has shape \(2,\), expected \(3,\)"):
        session.send(Push("left", (0, 1)))
    with pytest.raises(ValueError, match="33 orders in one request, expected at most 32"):
        session.send(*[Pause()] * 33)
    assert session.send() == []


def test_a_checkpoint_is_answered_with_its_path(launch: Launch, tmp_path: object) -> None:
    with launch(paused=True, arguments=["--checkpoints", str(tmp_path)]) as session:
        [ack] = session.send(Checkpoint())
        assert ack.reason.startswith(str(tmp_path))


def test_a_reset_is_marked_on_its_frame(session: LaunchedSession) -> None:
    reader = session.frames(64)
    # No more frames than the reader keeps.
    session.send(Reset(at_step=5), Pause(at_step=21), Resume())
    assert next(frame.step for frame in reader if frame.is_reset) == 5


def test_a_closed_session_gives_its_places_back(session: LaunchedSession) -> None:
    with cosplat.connect(session.name, timeout=PATIENCE) as second:
        frame = second.frames().next(PATIENCE)
        assert frame
        while session.status().frame_readers != 1:
            time.sleep(0.01)
    # What is held stays, and its place with it.
    assert np.isfinite(frame.positions).all()
    del frame
    while session.status().frame_readers != 0:
        time.sleep(0.01)
    with pytest.raises(ValueError, match="is closed"):
        second.frames()


def test_a_reader_carries_on_with_the_next_server(launch: Launch) -> None:
    with launch(session="same", paused=True) as first:
        with cosplat.connect("same", timeout=PATIENCE) as session:
            frames, objects = session.frames(), session.objects()
            one, before = frames.next(PATIENCE), objects.next(PATIENCE)
            assert one and before and session.send(Pause())
            first.process.kill()
            first.process.wait()
            with launch(session="same", paused=True) as second:
                two, after = frames.next(PATIENCE), objects.next(PATIENCE)
                assert two and two.is_new_run and two.epoch > one.epoch and two.missed == 0
                assert after and after["right"].id == 1
                assert session.scene().header.epoch == two.epoch
                assert session.send(Pause())
                assert session.hello.pid == second.process.pid


def test_a_loop_over_a_killed_server_raises(session: LaunchedSession) -> None:
    reader = session.frames()
    assert reader.next(PATIENCE)
    session.process.kill()
    session.process.wait()
    with pytest.raises(ServerLost, match="gave no sign of life"):
        for _ in reader:
            pass


def test_a_server_may_have_another_clock(launch: Launch, monkeypatch: pytest.MonkeyPatch) -> None:
    own_clock = time.monotonic
    for ahead in (1e5, -1e5):
        with launch(paused=True) as session, monkeypatch.context() as patched:
            patched.setattr(time, "monotonic", lambda: own_clock() + ahead)
            frames, end = session.frames(), own_clock() + 1.5
            while own_clock() < end:
                frames.next(0.05)
                assert not session.is_over(0)
            session.process.kill()
            session.process.wait()
            with pytest.raises(ServerLost):
                while not session.is_over(0):
                    time.sleep(0.05)


def test_other_publishers_are_ignored(domain: Domain) -> None:
    with Stranger(domain, "shared", hello()) as server, cosplat.connect("shared", timeout=PATIENCE) as session:
        reader = session.frames(64)
        impostor = Stranger(domain, "shared", None)
        impostor.publish(step=1, elements=1, epoch=99)
        server.publish(step=2, elements=1)
        frame = reader.next(PATIENCE)
        assert frame and (frame.step, frame.epoch) == (2, 5)
        assert reader.next(0.1) is None


def test_a_frame_that_contradicts_itself_is_skipped(domain: Domain) -> None:
    with Stranger(domain, "odd", hello()) as server, cosplat.connect("odd", timeout=PATIENCE) as session:
        reader = session.frames(64)
        server.publish(step=1, elements=3, count=4)
        server.publish(step=2, elements=3)
        with pytest.raises(Malformed, match="announces 4 elements and holds 3"):
            reader.next(PATIENCE)
        frame = reader.next(PATIENCE)
        assert frame and frame.step == 2
