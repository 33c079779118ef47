"""Many simulations as one environment of Gymnasium. Needs the extra `gym`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector import VectorEnv as GymnasiumVectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from .env import Action, Course, Env, Observation, T


class VectorEnv(GymnasiumVectorEnv[Observation, Action, NDArray[Any]]):
    """Environments whose servers step side by side, each in processes of its own; this process alone drives them.

    An environment whose episode is over begins the next one with the following `step`, whose action it does not see
    (`AutoresetMode.NEXT_STEP`). Each environment gives what it would give alone, bit for bit.

    What one environment raises is raised once all have made their step, with a note that says whose it is. The episode of that
    environment is over; the others are where they would be without it.
    """

    def __init__(self, envs: Sequence[Env]) -> None:
        """Takes over environments, and closes them with itself.

        Raises ValueError when there are none, or when their spaces differ.
        """
        if not envs:
            raise ValueError("there are 0 environments, expected at least 1")
        self.envs = list(envs)
        """The environments."""
        first = self.envs[0]
        for number, env in enumerate(self.envs):
            spaces = env.observation_space, env.action_space
            if spaces != (first.observation_space, first.action_space):
                raise ValueError(f"environment {number} has the spaces {spaces}, expected those of environment 0")
        self.num_envs = len(self.envs)
        self.metadata = {**first.metadata, "autoreset_mode": AutoresetMode.NEXT_STEP}
        self.single_observation_space = first.observation_space
        self.single_action_space = first.action_space
        self.observation_space = batch_space(first.observation_space, self.num_envs)
        self.action_space = batch_space(first.action_space, self.num_envs)
        self._is_over = np.ones(self.num_envs, bool)

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begins an episode of every environment: observations (environments, ...), infos.

        A `seed` counts up from environment to environment; a sequence has one for each. `options` go to every environment.
        """
        if seed is None or isinstance(seed, int):
            seeds: Sequence[int | None] = [None if seed is None else seed + number for number in range(self.num_envs)]
        else:
            seeds = seed
        if len(seeds) != self.num_envs:
            raise ValueError(f"there are {len(seeds)} seeds, expected {self.num_envs}")
        begun = self._driven([env.beginning(one, options) for env, one in zip(self.envs, seeds, strict=True)], lambda _: False)
        infos: dict[str, Any] = {}
        for number, (_, info) in enumerate(begun):
            infos = self._add_info(infos, info, number)
        return np.stack([observation for observation, _ in begun]), infos

    def step(
        self, actions: Action
    ) -> tuple[Observation, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Applies one action to each environment: observations, rewards, terminated, truncated, infos, one row each."""
        if len(actions) != self.num_envs:
            raise ValueError(f"there are {len(actions)} actions, expected {self.num_envs}")
        courses = [
            _next_episode(env) if is_over else env.acting(action)
            for env, action, is_over in zip(self.envs, actions, self._is_over, strict=True)
        ]
        results = self._driven(courses, lambda result: result[2] or result[3])
        observations, rewards, terminated, truncated, told = zip(*results, strict=True)
        infos: dict[str, Any] = {}
        for number, info in enumerate(told):
            infos = self._add_info(infos, info, number)
        over, cut = np.array(terminated, bool), np.array(truncated, bool)
        return np.stack(observations), np.array(rewards, np.float64), over, cut, infos

    def _driven(self, courses: Sequence[Course[T]], ends: Callable[[T], bool]) -> list[T]:
        """Takes the courses of all environments to their end, and raises the first error only then.

        `ends` tells of a result whether the episode is over.
        """
        # Where this is broken off, as by Ctrl-C, nobody knows who made which step.
        self._is_over[:] = True
        results, errors = _in_turn(courses)
        for number, result in results.items():
            self._is_over[number] = ends(result)
        if errors:
            for number, error in sorted(errors.items()):
                error.add_note(f"raised by environment {number}, counted from 0")
            raise errors[min(errors)]
        return [results[number] for number in range(len(courses))]

    def close_extras(self, **_: Any) -> None:
        """Stops the servers."""
        for env in self.envs:
            env.close()


def _next_episode(env: Env) -> Course[tuple[Observation, float, bool, bool, dict[str, Any]]]:
    observation, info = yield from env.beginning(None, None)
    return observation, 0.0, False, False, info


def _in_turn(courses: Sequence[Course[T]]) -> tuple[dict[int, T], dict[int, Exception]]:
    """Takes all courses to their end; wherever one waits for its server, the servers of the others work. Results, and errors."""
    results: dict[int, T] = {}
    errors: dict[int, Exception] = {}
    going = dict(enumerate(courses))
    while going:
        for number, course in list(going.items()):
            try:
                next(course)
                continue
            except StopIteration as end:
                results[number] = end.value
            except Exception as error:
                errors[number] = error
            del going[number]
    return results, errors
