"""A Gymnasium environment as a domain: each tick is a step, with an action chosen by the tree."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Mapping
from functools import cache, cached_property
from importlib.util import find_spec
from json import dumps, loads
from math import isfinite
from typing import Any, ClassVar, Final

from pydantic import BaseModel

from islandgp.domain import EventLog, Key, Leaf, RewardTable, Scene, SimulatorDomain, png
from islandgp.domain.checks import must_be_numbers
from islandgp.domains.gymnasium import world as settings
from islandgp.domains.gymnasium.spaces import Spaces
from islandgp.errors import ConfigError

OUTER_WRAPPERS: Final = ("TimeLimit", "OrderEnforcing", "PassiveEnvChecker")
"""Wrappers that are removed: `ticks` replaces the time limit, and the others only check calls."""


@cache
def environment(name: str, options: str, render: bool) -> Any:
    """Creates an environment; all episodes of a process share it and reset it.

    Args:
        name: as for `gymnasium.make`.
        options: further arguments, as JSON.
        render: True if frames are needed.
    """
    with warnings.catch_warnings():
        # Importing Box2D emits warnings about its types; where warnings are errors, it crashes.
        warnings.simplefilter("ignore")
        import gymnasium

        if render:  # into memory: no window is opened
            os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
            os.environ.setdefault("SDL_NO_SIGNAL_HANDLERS", "1")  # else pygame swallows SIGTERM
        render_options: dict[str, Any] = {"render_mode": "rgb_array"} if render else {}
        env = gymnasium.make(name, disable_env_checker=True, **loads(options), **render_options)
    while type(env).__name__ in OUTER_WRAPPERS:
        env = env.env  # type: ignore[attr-defined]
    if type(env.action_space) is gymnasium.spaces.Discrete:
        # `_faults` has checked the actions; a check in each step is half of CartPole's time.
        env.action_space.contains = lambda x: True  # type: ignore[method-assign]  # noqa: ARG005
    return env


class Gymnasium(SimulatorDomain):
    """The domain of a Gymnasium environment."""

    World: ClassVar[type[BaseModel]] = settings.GymnasiumWorld

    def __init__(self, world: settings.GymnasiumWorld, rewards: RewardTable) -> None:
        """Raises ConfigError if the environment is missing or does not fit."""
        super().__init__(world, rewards)
        if find_spec("gymnasium") is None:
            raise ConfigError(
                f"domain={world.name}: expected the package gymnasium, found none; install it"
                " with pip install 'islandgp[gymnasium]'."
            )
        spaces = Spaces.of(self.environment(render=False), world.environment)
        if fault := next(_faults(world, spaces), ""):
            raise ConfigError(f"world.{fault}")
        self.step_s = world.step_s
        self.schema = world.declared([n for n, at in spaces.places.items() if spaces.whole[at]])

    def environment(self, *, render: bool) -> Any:
        """The environment of this process. Raises ConfigError if it cannot be created.

        Args:
            render: True if frames are needed; MuJoCo's environments have some with MUJOCO_GL only,
                as it may abort a process without a display.
        """
        world = self.world
        try:
            plain = environment(world.environment, dumps(world.options), False)
            if not render:
                return plain
            mujoco = hasattr(plain.unwrapped, "mujoco_renderer")
            if mujoco and not os.environ.get("MUJOCO_GL"):
                return plain
            rendered = environment(world.environment, dumps(world.options), True)
        except Exception as error:  # Gymnasium and environments raise anything
            reason = " ".join(str(error).split())
            raise ConfigError(
                f"world.environment: expected one that gymnasium.make knows, found"
                f" {world.environment!r}: {reason}"
            ) from error
        if mujoco:  # without shadows a CPU renders ten times as fast
            quality = rendered.unwrapped.model.vis.quality
            quality.shadowsize = quality.offsamples = 0
        return rendered

    def begin(self, seed: int, log: EventLog, *, watched: bool) -> tuple[Any, Mapping[str, Leaf]]:
        """See `SimulatorDomain`."""
        env = self.environment(render=watched)
        episode = _Episode(self.world, env, _spaces(env), seed, log)
        return episode, {n: episode.leaf(choice, n) for n, choice in self.world.actions.items()}

    def reader(self, episode: _Episode) -> Callable[[], list[float]]:
        """See `SimulatorDomain`."""
        return episode.reader(self.schema.vocabulary.keys)


@cache
def _spaces(env: Any) -> Spaces:
    return Spaces.of(env, "the environment")


class _Episode:
    """One episode. Points are credited to the tree's action that chose the environment's."""

    def __init__(
        self, world: settings.GymnasiumWorld, env: Any, spaces: Spaces, seed: int, log: EventLog
    ) -> None:
        self.env, self.log = env, log
        self.shrink, self.frame_every = world.shrink, world.frame_every
        self.total, self.steps = 0.0, 0
        self._at = {n: spaces.places[o.at] for n, o in world.observations.items()}
        self._read, self._act = spaces.read, spaces.act
        self._values = self._read(env.reset(seed=seed)[0])
        self._step, self._steps_matter = env.step, log.matters("step")
        places = {"reward": -2, "step": -1, **self._at}  # of the numbers of a step
        self._signals = [(n, places[s.of], s.above, s.below) for n, s in world.signals.items()]
        none = spaces.none if world.otherwise is None else world.otherwise
        self._none: tuple[Any, str] = (none, "")
        self._chosen: tuple[Any, str] = self._none

    def leaf(self, choice: settings.Choice, name: str) -> Leaf:
        """A leaf that chooses an action of the environment, and succeeds immediately."""
        places = {key: each.at for key, each in choice.arguments.items()}

        def choose(**values: float) -> bool:
            action: Any = self._chosen[0] if choice.do is None else choice.do
            if values:
                action = [*action]
                for key, value in values.items():
                    action[places[key]] = value
            self._chosen = (action, name)
            return True

        return choose

    def reader(self, keys: Mapping[str, Key]) -> Callable[[], list[float]]:
        """See `SimulatorDomain`. Reads observations directly, without a dict."""
        places = [(self._at[name], *key.bounds) for name, key in keys.items()]
        choices = [i for i, key in enumerate(keys.values()) if key.choices]  # words and flags

        def read() -> list[float]:
            self._chosen = self._none
            values = self._values
            readings = [
                low if (value := values[at]) < low else high if value > high else value
                for at, low, high in places
            ]
            if not isfinite(sum(readings)):
                found = dict(zip(keys, readings, strict=True))
                must_be_numbers(found, "key", keys, keys, self.env.step)
            for i in choices:
                readings[i] = float(round(readings[i]))
            return readings

        return read

    def step(self) -> str:
        """See `Simulation`: one step of the environment."""
        log, act = self.log, self._act
        action, log.action = self._chosen
        observation, reward, terminated, truncated, _ = self._step(act(action) if act else action)
        self._values = values = self._read(observation)
        reward = float(reward)
        self.steps = steps = self.steps + 1
        self.total += reward
        log("reward", reward)
        if self._steps_matter:
            log("step")
        for event, place, above, below in self._signals:
            if above < (values[place] if place >= 0 else steps if place == -1 else reward) < below:
                log(event)
        return "terminated" if terminated else "time" if truncated else ""

    def measures(self) -> Mapping[str, float]:
        """See `Simulation`."""
        return {"return": self.total, "steps": self.steps}

    def scene(self) -> Scene | None:
        """See `Simulation`. None if the environment renders no frames."""
        if not self.env.render_mode:
            return None
        return self._picture if self.steps % self.frame_every == 0 else self._between

    @cached_property
    def _picture(self) -> Scene:
        """The environment's picture, rendered when it is requested."""
        height, width, _ = self.env.render().shape
        bounds = (0.0, 0.0, float(width), float(height))
        return Scene(bounds, frame=lambda: png(self.env.render()[:: self.shrink, :: self.shrink]))

    @cached_property
    def _between(self) -> Scene:
        """A tick without a frame, in which the previous one is shown."""
        return Scene(self._picture.bounds)


def _faults(world: settings.GymnasiumWorld, spaces: Spaces) -> Iterator[str]:
    """What the environment lacks of the configuration."""
    name, actions, bounds = world.environment, spaces.actions, spaces.bounds
    for key, observation in world.observations.items():
        if (at := observation.at) not in spaces.places:
            expected = f"{spaces.named()}, the numbers of {name}"
            yield f"observations.{key}.at: expected {expected}, found {at!r}"
    choices = {f"actions.{key}.do": choice.do for key, choice in world.actions.items()}
    for path, do in {**choices, "otherwise": world.otherwise}.items():
        if do is not None and not spaces.accepts(do):
            found = [*do] if isinstance(do, tuple) else do
            yield f"{path}: expected an action of {name}, {actions}, found {found}"
    for key, choice in world.actions.items():
        for argument, filled in choice.arguments.items():
            path = f"actions.{key}.arguments.{argument}"
            if filled.at >= len(bounds):
                yield f"{path}.at: expected the place of a number of {actions}, found {filled.at}"
                continue
            (low, high), (least, most) = bounds[filled.at], filled.range
            if not low <= least < most <= high:
                expected = f"two rising numbers from {low:g} to {high:g}"
                yield f"{path}.range: expected {expected}, found {[least, most]}"
