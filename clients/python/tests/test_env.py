"""The environment is one of Gymnasium's."""

import warnings
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray
from conftest import SCENE
from cosplat import BadName, Domain, Env, Objects, SetVelocity
from gymnasium.utils.env_checker import check_env


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
