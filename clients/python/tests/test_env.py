"""The environment is one of Gymnasium's."""

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from conftest import SCENE
from cosplat import BadName, Domain, Env, Objects, Refused, SetVelocity, VectorEnv
from gymnasium.error import ClosedEnvironmentError, InvalidAction, ResetNeeded
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv


def towards(objects: Objects, action: NDArray[np.float64]) -> float:
    return -float(np.linalg.norm(objects["left"].com - (0.5, 0.1, 0.0)))


@pytest.fixture
def env(domain: Domain) -> Iterator[Env]:
    own = Env(
        SCENE,
        observe=["left", "right"],
        forces={"left": 20.0},
        collider_velocities={"floor": 0.1},
        reward=towards,
        terminated=lambda objects: bool(objects["left"].com[1] < 0.0),
        randomise=lambda random: [SetVelocity("left", random.normal(scale=0.1, size=3))],
        steps_per_action=2,
        max_actions=5,
    )
    yield own
    own.close()


def test_gymnasium_finds_nothing_wrong(env: Env) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # Positions and velocities have no bounds, and the environment is made without gymnasium.make.
        for harmless in ("(?s).*Box observation space m..imum value is -?infinity.*", ".*spec.*"):
            warnings.filterwarnings("ignore", harmless)
        check_env(env)


def test_observations_are_what_the_objects_do(env: Env) -> None:
    observation, info = env.reset(seed=1)
    assert observation.shape == (26,) and info["cause"] == "COMPLETE"
    action = np.array([1.0, 0, 0, 0, 0, 0])
    for count in range(1, 6):
        observation, reward, terminated, truncated, info = env.step(action)
        assert not terminated and truncated == (count == 5)
    # 20 N for ten steps of 20 ms on 8.56 kg, and the start's 0.1 m/s at random.
    assert 0.2 < observation[7] < 0.8
    assert reward == pytest.approx(-np.linalg.norm(observation[:3] - (0.5, 0.1, 0.0)))


def test_a_seed_gives_the_same_episode_bit_for_bit(env: Env) -> None:
    def episode(seed: int) -> list[bytes]:
        random = np.random.default_rng(5)
        seen = [env.reset(seed=seed)[0].tobytes()]
        return seen + [env.step(random.uniform(-1, 1, 6))[0].tobytes() for _ in range(5)]

    first = episode(3)
    assert episode(4) != first
    assert episode(3) == first


def test_orders_of_an_episode_come_with_its_start(env: Env) -> None:
    observation, _ = env.reset(options={"orders": [SetVelocity("right", (0, 0, 2))]})
    assert observation[13 + 9] == pytest.approx(2.0, abs=1e-3)


def test_names_that_the_scene_does_not_have_are_refused(domain: Domain) -> None:
    forces: dict[str, float]
    for observed, forces in (("middle", {"left": 1.0}), ("left", {"middle": 1.0}), ("left", {})):
        with pytest.raises(BadName):
            Env(SCENE, observe=[observed], forces=forces, reward=towards)
    assert domain.sessions() == {}


def test_what_is_outside_of_the_space_is_clipped_to_it(env: Env) -> None:
    def episode(actions: Any) -> list[bytes]:
        return [env.reset(seed=3)[0].tobytes(), *(env.step(action)[0].tobytes() for action in actions)]

    inside = np.array([[1.0, 0, -1, 0, 1, 0], [-1, 1, 1, 0, 0, -1]])
    # Numbers of any kind, as they come from any policy.
    assert episode(inside * [1, 100, 1e300, 1, 7, 3]) == episode(inside) == episode(inside.astype(np.float32) * 2)
    assert episode(inside.astype(int).tolist()) == episode(inside)


def test_the_reward_sees_the_action_that_acts(domain: Domain) -> None:
    seen: list[list[float]] = []

    def reward(objects: Objects, action: NDArray[np.float64]) -> float:
        seen.append(action.tolist())
        return 0.0

    env = Env(SCENE, observe=["left"], forces={"left": 1.0}, reward=reward, max_actions=3)
    try:
        env.reset()
        env.step(np.array([100.0, -0.5, -2.0]))
    finally:
        env.close()
    assert seen == [[1.0, -0.5, -1.0]]


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ([0.0, 0.0], r"the action has shape \(2,\), expected \(6,\): three numbers for each of left, floor"),
        (np.zeros(3), r"shape \(3,\), expected \(6,\)"),
        (np.zeros(9), r"shape \(9,\), expected \(6,\)"),
        (np.zeros((2, 3)), r"shape \(2, 3\), expected \(6,\)"),
        (0.5, r"shape \(\), expected \(6,\)"),
        ([np.nan, 0, 0, 0, 0, 0], "the action is .nan, .*, expected finite numbers"),
        ([0, 0, 0, 0, 0, -np.inf], "expected finite numbers"),
        (None, "is no array of numbers"),
        ("up", "is no array of numbers"),
        (["1"] * 6, "is no array of numbers"),
        ([1j] * 6, "is no array of numbers"),
        ([[0, 0], 0, 0], "is no array of numbers"),
    ],
)
def test_what_is_no_action_is_refused(env: Env, action: Any, words: str) -> None:
    env.reset(seed=1)
    before = env.session.status().step
    with pytest.raises(InvalidAction, match=words):
        env.step(action)
    # Nothing was sent, and the episode goes on.
    assert env.step(np.zeros(6))[0].shape == (26,) and env.session.status().step <= before + 2


def test_an_episode_has_a_beginning_and_an_end(domain: Domain) -> None:
    ends = iter([False, True, False, False])
    env = Env(SCENE, observe=["left"], forces={"left": 1.0}, reward=towards, terminated=lambda _: next(ends), max_actions=2)
    none = np.zeros(3)
    try:
        with pytest.raises(ResetNeeded, match=r"cannot call env.step\(\) before calling env.reset\(\)"):
            env.step(none)
        for end in ((True, True), (False, True)):
            env.reset()
            assert env.step(none)[2:4] == (False, False)
            assert env.step(none)[2:4] == end
            for _ in range(2):
                with pytest.raises(ResetNeeded, match=r"after the end of an episode: call env.reset\(\)"):
                    env.step(none)
        with pytest.raises(Refused):
            env.reset(options={"orders": [SetVelocity("left", (np.nan, 0, 0))]})
        with pytest.raises(ResetNeeded, match="after a reset that failed"):
            env.step(none)
        # The list of ends is over.
        env.reset()
        with pytest.raises(RuntimeError):
            env.step(none)
        with pytest.raises(ResetNeeded, match="after an action that failed"):
            env.step(none)
        assert env.reset()[0].shape == (13,)
    finally:
        env.close()
    env.close()
    for name, call in (("step", lambda: env.step(none)), ("reset", env.reset)):
        with pytest.raises(ClosedEnvironmentError, match=rf"cannot call env.{name}\(\) after env.close\(\)"):
            call()


def test_numbers_without_sense_are_refused_before_a_server_starts(domain: Domain) -> None:
    numbers: list[dict[str, Any]] = [{"steps_per_action": 0}, {"max_actions": -1}, {"forces": {"left": np.nan}}]
    for wrong in numbers:
        with pytest.raises(ValueError, match="expected"):
            Env(SCENE, **{"observe": ["left"], "forces": {"left": 1.0}, "reward": towards, "program": "/nowhere", **wrong})


def make(largest: float = 20.0) -> Env:
    return Env(
        SCENE,
        observe=["left"],
        forces={"left": largest},
        reward=towards,
        randomise=lambda random: [SetVelocity("left", random.normal(scale=0.1, size=3))],
        steps_per_action=2,
        max_actions=3,
    )


def test_many_environments_give_what_each_gives_alone(domain: Domain) -> None:
    actions = np.random.default_rng(7).uniform(-1, 1, (5, 3, 3))
    many, others = VectorEnv([make() for _ in range(3)]), SyncVectorEnv([make] * 3)
    try:
        seeds: list[int | list[int | None]] = [5, [9, 8, 7]]
        for seed in seeds:
            begun = many.reset(seed=seed)
            assert begun[0] in many.observation_space and data_equivalence(begun, others.reset(seed=seed))
            # The fourth begins new episodes: each has three actions.
            for action in actions:
                assert data_equivalence(many.step(action), others.step(action))
        assert many.observation_space == others.observation_space and many.action_space == others.action_space
        assert many.metadata["autoreset_mode"] == others.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
        with pytest.raises(ValueError, match="there are 2 actions, expected 3"):
            many.step(actions[0, :2])
    finally:
        many.close()
        others.close()
    assert domain.sessions() == {}


def test_a_refusal_leaves_many_environments_in_step(domain: Domain) -> None:
    # Whatever is not 0 is a force that no server takes.
    many, others = VectorEnv([make(), make(1e300), make()]), SyncVectorEnv([make] * 3)
    rest, bad = np.zeros((3, 3)), np.zeros((3, 3))
    bad[1] = 1.0
    try:
        many.reset(seed=5)
        others.reset(seed=5)
        with pytest.raises(Refused) as error:
            many.step(bad)
        assert error.value.__notes__ == ["raised by environment 1, counted from 0"]
        others.step(rest)
        # The third ends two episodes, the fourth begins them anew; that of environment 1 began with the second.
        for count in (2, 3, 4, 5):
            observed, rewards, over, cut, infos = many.step(rest)
            expected, right, _, ends, told = others.step(rest)
            assert np.array_equal(observed[[0, 2]], expected[[0, 2]]) and np.array_equal(rewards[[0, 2]], right[[0, 2]])
            assert cut.tolist() == [ends[0], count == 5, ends[2]] and not over.any()
            for number in (0, 2):
                assert infos["state_hash"][number] == told["state_hash"][number]
        # So it is where an episode begins.
        with pytest.raises(Refused):
            many.reset(seed=5, options={"orders": [SetVelocity("left", (np.nan, 0, 0))]})
        begun, _ = many.reset(seed=5)
        assert np.array_equal(begun, others.reset(seed=5)[0])
    finally:
        many.close()
        others.close()


def test_servers_of_many_environments_step_side_by_side(domain: Domain) -> None:
    many = VectorEnv([make() for _ in range(2)])
    try:
        many.reset(seed=1)
        courses = [env.acting(np.zeros(3)) for env in many.envs]
        for course in courses:
            next(course)
        # Both servers made their step, though nobody has waited for an answer.
        for env in many.envs:
            while env.session.status().step < 2:
                pass
        for course in courses:
            course.close()
    finally:
        many.close()
