"""An environment of Gymnasium as a domain: a tick is a step, and the tree chooses its action."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from json import dumps, loads
from typing import Any, ClassVar, Final, Self

from pydantic import BaseModel

from islandgp.bt.closures import Tick
from islandgp.bt.engine import compile_tree
from islandgp.bt.node import SUCCESS, Node
from islandgp.domain import Observer, Outcome, Scene, png
from islandgp.domains.gymnasium import world as settings
from islandgp.errors import ConfigError
from islandgp.scoring.rewards import RewardTable, Worth, worth
from islandgp.ticking import once_a_thread

HELPERS: Final = ("TimeLimit", "OrderEnforcing", "PassiveEnvChecker")
"""Wrappers of `gymnasium.make` that the domain does without: `ticks` limits the time."""


Chosen = tuple[int, str]
"""The number of an environment's action, and the tree's action that chose it; "" for none."""


@once_a_thread
def environment(name: str, options: str, render: bool) -> Any:
    """An environment, one for all episodes of a thread; `reset` makes it anew.

    Args:
        name: as `gymnasium.make` takes it.
        options: further arguments, as JSON.
        render: whether pictures will be asked for.
    """
    with warnings.catch_warnings():
        # Importing Box2D warns of its own types; where warnings are errors, it crashes.
        warnings.simplefilter("ignore")
        import gymnasium

        if render:  # into memory: no window is opened
            os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
        more: dict[str, Any] = {"render_mode": "rgb_array"} if render else {}
        env = gymnasium.make(name, disable_env_checker=True, **loads(options), **more)
    while type(env).__name__ in HELPERS:
        env = env.env  # type: ignore[attr-defined]
    return env


class Gymnasium:
    """The domain of one environment."""

    World: ClassVar[type[BaseModel]] = settings.World
    Rewards: ClassVar[type[BaseModel]] = RewardTable

    def __init__(self, world: settings.World, rewards: RewardTable) -> None:
        self.world = world
        self.rewards = rewards
        self.schema = world.declared()
        self.step_s = world.step_s

    @classmethod
    def make(cls, world: settings.World, rewards: RewardTable) -> Self:
        """See `Domain`. Raises ConfigError where the environment is not there, or another one."""
        if find_spec("gymnasium") is None:
            raise ConfigError(
                f"domain={world.name}: expected the package gymnasium, found none; install it"
                " with pip install 'islandgp[gymnasium]'."
            )
        domain = cls(world, rewards)
        _check(world, domain.environment(render=False))
        return domain

    def environment(self, *, render: bool) -> Any:
        """The environment of this thread. Raises ConfigError where it cannot be made."""
        world = self.world
        try:
            return environment(world.environment, dumps(world.options), render)
        except Exception as error:  # Gymnasium and environments raise anything
            what = " ".join(str(error).split())
            raise ConfigError(
                f"world.environment: expected one that gymnasium.make knows, found"
                f" {world.environment!r}: {what}"
            ) from error

    def run_episode(
        self,
        tree: Node,
        seed: int,
        weights: Mapping[str, float],
        observer: Observer | None = None,
    ) -> Outcome:
        """See `Domain`."""
        world, places = self.world, self.schema.vocabulary.places
        env = self.environment(render=observer is not None)
        components = dict.fromkeys(self.schema.components, 0.0)
        counts = dict.fromkeys(world.signals, 0)
        board, none = [0.0] * len(places), (world.otherwise, "")
        chosen: list[Chosen] = [none]
        leaves = {name: _leaf((choice.do, name), chosen) for name, choice in world.actions.items()}
        watch = None if observer is None else observer.node
        tick = compile_tree(tree, leaves, board, places, watch=watch)
        sense = _sense(world.observations, places, board)
        award = _award(worth(self.rewards, weights), components, chosen, observer)
        take, total, done, ending = env.step, 0.0, 0, ""
        values = env.reset(seed=seed)[0].tolist()
        signals, earns = _signals(world, len(values)), self.rewards.events.keys()
        lasting = "step" in earns
        scene = None if observer is None else _scene(env, world.shrink)
        while not ending:
            sense(values)
            chosen[0] = none
            tick()
            if observer is not None:
                observer.tick(board, scene)
            observation, reward, terminated, truncated, _ = take(chosen[0][0])
            values, reward, done = observation.tolist(), float(reward), done + 1
            total += reward
            award("reward", reward)
            if lasting:
                award("step", 1.0)
            told = (*values, reward, done)
            for event, place, above, below in signals:
                if above < told[place] < below:
                    counts[event] += 1
                    if event in earns:
                        award(event, 1.0)
            if terminated:
                ending = "terminated"
            elif truncated or done == world.ticks:
                ending = "time"
        return Outcome(
            components=components,
            counters={"return": total, "steps": float(done)}
            | {name: float(n) for name, n in counts.items()},
            seconds=done * self.step_s,
            endings=(ending,),
        )


def _leaf(choice: Chosen, chosen: list[Chosen]) -> Tick:
    """Chooses an action of the environment, and succeeds at once."""

    def tick(_fresh: bool) -> int:
        chosen[0] = choice
        return SUCCESS

    return tick


def _award(
    value: Worth, components: dict[str, float], chosen: list[Chosen], observer: Observer | None
) -> Callable[[str, float], None]:
    """What adds up the points of events, and credits them to the action that was chosen."""

    def award(event: str, amount: float) -> None:
        component, points = value(event, amount)
        if component:
            components[component] += points
            if observer is not None:
                observer.credit(component, points, event, chosen[0][1])

    return award


def _sense(
    observations: Mapping[str, settings.Observation],
    places: Mapping[str, int],
    board: list[float],
) -> Callable[[list[float]], None]:
    """What puts an observation onto the blackboard."""
    flags = [(places[n], o.at) for n, o in observations.items() if o.flag]
    numbers = [(places[n], o.at, *o.range) for n, o in observations.items() if not o.flag]

    def sense(values: list[float]) -> None:
        for place, at, low, high in numbers:
            value = values[at]
            board[place] = low if value < low else high if value > high else value
        for place, at in flags:
            board[place] = float(values[at] > 0.5)

    return sense


def _signals(world: settings.World, size: int) -> list[tuple[str, int, float, float]]:
    """(event, place, above, below): places behind an observation's `size` numbers are OWN's."""
    places = {name: size + i for i, name in enumerate(settings.OWN)}
    places |= {name: observation.at for name, observation in world.observations.items()}
    return [(name, places[s.of], s.above, s.below) for name, s in world.signals.items()]


def _scene(env: Any, shrink: int) -> Scene:
    """The environment's own picture, as it is whenever it is asked for."""
    height, width, _ = env.render().shape
    bounds = (0.0, 0.0, float(width), float(height))
    return Scene(bounds, frame=lambda: png(env.render()[::shrink, ::shrink]))


def _check(world: settings.World, env: Any) -> None:
    """Raises ConfigError where the environment has not what the configuration names."""
    observed, actions = env.observation_space, env.action_space
    shape = getattr(observed, "shape", None)
    if type(observed).__name__ != "Box" or shape is None or len(shape) != 1:
        raise ConfigError(
            f"world.environment: expected observations that are a row of numbers (Box), found"
            f" {observed} in {world.environment}."
        )
    if type(actions).__name__ != "Discrete":
        raise ConfigError(
            f"world.environment: expected actions to choose from (Discrete), found {actions} in"
            f" {world.environment}."
        )
    for name, observation in world.observations.items():
        if observation.at >= shape[0]:
            raise ConfigError(
                f"world.observations.{name}.at: expected 0 to {shape[0] - 1}, as"
                f" {world.environment} observes {shape[0]} numbers, found {observation.at}"
            )
    numbers = {f"actions.{name}.do": choice.do for name, choice in world.actions.items()}
    for path, number in {**numbers, "otherwise": world.otherwise}.items():
        if number >= actions.n:
            raise ConfigError(
                f"world.{path}: expected 0 to {actions.n - 1}, the actions of"
                f" {world.environment}, found {number}"
            )
