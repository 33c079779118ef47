"""A simulation as an environment of Gymnasium. Needs the extra `gym`."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, TypeAlias, TypeVar

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError, InvalidAction, ResetNeeded
from numpy.typing import NDArray

from .domain import Domain
from .errors import BadName
from .launch import LaunchedSession, launch
from .lockstep import Cause, Done
from .orders import ColliderVelocity, Force, Order, Reset
from .streams import Objects

Observation = NDArray[np.float64]
Action = NDArray[np.float64]

T = TypeVar("T")
Course: TypeAlias = Generator[None, None, T]
"""Something that pauses while a server works, and then has a result."""

OBSERVED = ("com", "rotation", "linear_velocity", "angular_velocity")
"""What is observed of an object: 3 + 4 + 3 + 3 numbers, in SI units."""


_LARGEST = 1.0
"""An action is three numbers from minus this to this for each name."""


class Env(gymnasium.Env[Observation, Action]):
    """A server of its own in lock-step: an action acts for some steps, and the objects are what is observed.

    The same seed and actions give the same observations, bit for bit. As in Gymnasium's own environments, what of an action is
    outside of its space is clipped to it.
    """

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(
        self,
        scene: str | os.PathLike[str],
        *,
        observe: Sequence[str],
        reward: Callable[[Objects, Action], float],
        forces: Mapping[str, float] | None = None,
        collider_velocities: Mapping[str, float] | None = None,
        terminated: Callable[[Objects], bool] = lambda objects: False,
        randomise: Callable[[np.random.Generator], Sequence[Order]] = lambda random: (),
        steps_per_action: int = 1,
        max_actions: int = 1000,
        threads: int = 0,
        program: str | os.PathLike[str] | None = None,
        domain: Domain | None = None,
    ) -> None:
        """Starts the server.

        `observe` names objects; an observation is what OBSERVED says of each of them, in this order. An action is three
        numbers from -1 to 1 per name in `forces` (largest force on the object [N]) and then per name in
        `collider_velocities` (largest velocity [m/s]). It acts for `steps_per_action` steps; an episode is truncated after
        `max_actions`. `reward` and `terminated` judge the objects after an action. `randomise` gives orders for the start
        of an episode from the environment's own random numbers.

        Raises LaunchFailed, BadName for names that the scene does not have, and ValueError for other values.
        """
        for what, count in (("steps_per_action", steps_per_action), ("max_actions", max_actions)):
            if count < 1:
                raise ValueError(f"{what} is {count}, expected at least 1")
        for name, largest in [*(forces or {}).items(), *(collider_velocities or {}).items()]:
            if not math.isfinite(largest):
                raise ValueError(f"the largest value for {name!r} is {largest}, expected a finite number")
        self._forces = dict(forces or {})
        self._velocities = dict(collider_velocities or {})
        self._reward, self._terminated, self._randomise = reward, terminated, randomise
        self._steps, self._max_actions = steps_per_action, max_actions
        self._session: LaunchedSession = launch(
            scene,
            participants=["env"],
            threads=threads,
            program=program,
            domain=domain,
        )
        try:
            scene_names = self._session.scene()
            self._observed = [scene_names.object_id(name) for name in observe]
            for name in self._forces:
                scene_names.object_id(name)
            for name in self._velocities:
                scene_names.collider_number(name)
            if not self._forces and not self._velocities:
                raise BadName("an environment needs a name in `forces` or `collider_velocities`")
            self._objects = self._session.objects(depth=64)
            self._participant = self._session.participate("env")
        except BaseException:
            self._session.close()
            raise
        self._actions = 0
        # Why there can be no step.
        self._needs_reset: str | None = "before calling env.reset()"
        self._is_closed = False
        size = 13 * len(self._observed)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (size,), np.float64)
        size = 3 * (len(self._forces) + len(self._velocities))
        self.action_space = gymnasium.spaces.Box(-_LARGEST, _LARGEST, (size,), np.float64)

    @property
    def session(self) -> LaunchedSession:
        """The session, for renderers and recorders of one's own."""
        return self._session

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Back to the initial state; the first step from there is made.

        `options["orders"]` are orders for its start, after those of `randomise`. Raises ClosedEnvironmentError.
        """
        return _finish(self.beginning(seed, options))

    def step(self, action: Action) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Applies an action for `steps_per_action` steps: observation, reward, terminated, truncated, info.

        Raises InvalidAction for another shape and for what is no finite number, ResetNeeded before `reset` and after the end of
        an episode, ClosedEnvironmentError after `close`.
        """
        return _finish(self.acting(action))

    def beginning(self, seed: int | None, options: dict[str, Any] | None) -> Course[tuple[Observation, dict[str, Any]]]:
        """`reset` in parts: it pauses wherever the server works, so that several environments can take turns."""
        self._check_open("reset")
        super().reset(seed=seed)
        self._actions = 0
        self._needs_reset = "after a reset that failed: call env.reset()"
        orders = [*self._randomise(self.np_random), *(options or {}).get("orders", ())]
        submitted = self._participant.submit(Reset(), *orders)
        yield
        done = submitted.done()
        observation = self._observe(self._objects.at(done.step))
        self._needs_reset = None
        return observation, _info(done)

    def acting(self, action: Action) -> Course[tuple[Observation, float, bool, bool, dict[str, Any]]]:
        """`step` in parts, like `beginning`; what `step` refuses is refused at once, before anything is sent."""
        self._check_open("step")
        if self._needs_reset is not None:
            raise ResetNeeded(f"cannot call env.step() {self._needs_reset}")
        return self._acting(self._clipped(action))

    def _acting(self, action: Action) -> Course[tuple[Observation, float, bool, bool, dict[str, Any]]]:
        self._needs_reset = "after an action that failed: call env.reset()"
        parts = action.reshape(-1, 3)
        for _ in range(self._steps):
            # Forces and velocities act for one step each.
            submitted = self._participant.submit(*self._orders(parts))
            yield
            done = submitted.done()
            if done.cause is Cause.TERMINATE:
                break
        objects = self._objects.at(done.step)
        self._actions += 1
        is_over = bool(self._terminated(objects))
        is_cut = self._actions >= self._max_actions or done.cause is Cause.TERMINATE
        reward = float(self._reward(objects, action))
        self._needs_reset = "after the end of an episode: call env.reset()" if is_over or is_cut else None
        return self._observe(objects), reward, is_over, is_cut, _info(done)

    def close(self) -> None:
        """Stops the server."""
        self._is_closed = True
        self._participant.close()
        self._session.close()

    def _check_open(self, what: str) -> None:
        if self._is_closed:
            raise ClosedEnvironmentError(f"cannot call env.{what}() after env.close()")

    def _clipped(self, action: Action) -> Action:
        """An action within its space, in memory of its own. Raises InvalidAction."""
        shape = self.action_space.shape
        try:
            values = np.asarray(action)
        except (TypeError, ValueError) as error:
            raise InvalidAction(f"an action is no array of numbers: {error}") from None
        if values.dtype.kind not in "fiub":
            raise InvalidAction(f"the action {action!r} is no array of numbers")
        if values.shape != shape:
            names = ", ".join([*self._forces, *self._velocities])
            raise InvalidAction(f"the action has shape {values.shape}, expected {shape}: three numbers for each of {names}")
        if not np.isfinite(values).all():
            raise InvalidAction(f"the action is {values.tolist()}, expected finite numbers")
        clipped: Action = np.clip(values.astype(np.float64), -_LARGEST, _LARGEST)
        return clipped

    def _orders(self, parts: NDArray[np.float64]) -> list[Order]:
        forces = zip(self._forces.items(), parts, strict=False)
        orders: list[Order] = [Force(name, largest * part) for (name, largest), part in forces]
        velocities = zip(self._velocities.items(), parts[len(self._forces) :], strict=True)
        return orders + [ColliderVelocity(name, largest * part) for (name, largest), part in velocities]

    def _observe(self, objects: Objects) -> Observation:
        states = objects.states[self._observed]
        rows: Observation = np.concatenate([states[name].reshape(len(states), -1) for name in OBSERVED], axis=1)
        return rows.ravel()


def _finish(course: Course[T]) -> T:
    while True:
        try:
            next(course)
        except StopIteration as end:
            result: T = end.value
            return result


def _info(done: Done) -> dict[str, Any]:
    # A text, as Gymnasium's vectors have no room for 64 bits without sign.
    return {"sim_time": done.sim_time, "state_hash": f"{done.state_hash:016x}", "cause": done.cause.name}
