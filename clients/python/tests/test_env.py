"""The environment is one of Gymnasium's."""

import warnings
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from conftest import SCENE
from cosplat import BadName, Domain, Env, Objects, SetVelocity, VectorEnv
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


def make() -> Env:
    return Env(
        SCENE,
        observe=["left"],
        forces={"left": 20.0},
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
