"""The spaces of an environment: observations as a row of numbers, and actions from numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import prod
from operator import methodcaller
from typing import Any

from islandgp.errors import ConfigError

Read = Callable[[Any], list[float]]


@dataclass(frozen=True)
class Spaces:
    """Conversion of an environment's observations and actions."""

    read: Read  # (observation) -> its numbers
    places: Mapping[int | str, int]  # their indices, by place and, of a Dict, by `key.place`
    whole: tuple[bool, ...]  # of each value in an observation: True for a whole number
    actions: Any  # the environment's space of actions
    act: Callable[[Any], Any] | None  # (list of numbers) -> action; None: an action is a number
    none: int | tuple[float, ...]  # the first of each choice, or zeros
    bounds: tuple[tuple[float, float], ...] = ()  # of each number of a Box

    @classmethod
    def of(cls, env: Any, name: str) -> Spaces:
        """The spaces of an environment. Raises ConfigError for spaces that cannot be used."""
        read, numbers = _observations(env.observation_space, name)
        places: dict[int | str, int] = {path: at for at, (path, _) in enumerate(numbers) if path}
        places |= {at: at for at in range(len(numbers))}
        whole = tuple(each for _, each in numbers)
        return cls(read, places, whole, env.action_space, *_actions(env.action_space, name))

    def named(self) -> str:
        """The places of an observation as text."""
        names = [place for place in self.places if isinstance(place, str)]
        return f"0 to {len(self.whole) - 1}" + (f" or one of {', '.join(names)}" if names else "")

    def accepts(self, action: int | tuple[float, ...]) -> bool:
        """True for an action of the environment."""
        if isinstance(action, int) or self.act is None:
            return isinstance(action, int) and self.act is None and self._contains(action)
        whole = self.bounds or not any(number % 1 for number in action)
        return bool(whole) and self._contains(self.act(action))

    def _contains(self, action: Any) -> bool:
        return bool(type(self.actions).contains(self.actions, action))  # not the quick one's


def _observations(space: Any, name: str) -> tuple[Read, list[tuple[str, bool]]]:
    """A function that reads an observation; the path of each number ("": none), True for whole."""
    kind = type(space).__name__
    if kind == "Discrete":
        return lambda value: [float(value)], [("", True)]
    if kind in ("MultiDiscrete", "MultiBinary") or (kind == "Box" and len(space.shape) == 1):
        is_real = space.dtype.kind == "f"
        to_list: Read = methodcaller("tolist")
        read = to_list if is_real else lambda values: to_list(values.ravel().astype(float))
        return read, [("", not is_real)] * prod(space.shape)
    if kind in ("Dict", "Tuple"):
        inner: Any = space.spaces.items() if kind == "Dict" else enumerate(space.spaces)
        parts = [(key, *_observations(inside, name)) for key, inside in inner]
        return (
            lambda values: [number for key, read, _ in parts for number in read(values[key])],
            [
                (_path(key, at, numbers) if kind == "Dict" else "", whole)
                for key, _, numbers in parts
                for at, (_, whole) in enumerate(numbers)
            ],
        )
    raise ConfigError(
        f"world.environment: expected observations that are numbers (a Box with one row, Discrete,"
        f" MultiDiscrete, MultiBinary, or a Dict or Tuple of them), found {space} in {name}."
    )


def _path(key: str, at: int, numbers: list[tuple[str, bool]]) -> str:
    """`key` for the only number of a key, else `key.place`."""
    inside = numbers[at][0]
    return key if len(numbers) == 1 and not inside else f"{key}.{inside or at}"


def _actions(
    space: Any, name: str
) -> tuple[Callable[[Any], Any] | None, int | tuple[float, ...], tuple[tuple[float, float], ...]]:
    """A function that makes an action, the default action, and the bounds of `Spaces`."""
    import numpy as np

    kind = type(space).__name__
    if kind == "Discrete":
        return None, int(space.start), ()
    if kind in ("MultiDiscrete", "MultiBinary", "Box") and len(space.shape) == 1:
        bounds: tuple[tuple[float, float], ...] = ()
        if kind == "Box":
            bounds = tuple(zip(space.low.tolist(), space.high.tolist(), strict=True))
        starts = getattr(space, "start", np.zeros(space.shape)).astype(float).tolist()
        none = tuple(min(high, max(low, 0.0)) for low, high in bounds) or tuple(starts)
        return lambda action: np.array(action, space.dtype), none, bounds
    raise ConfigError(
        f"world.environment: expected actions to choose from (Discrete, or MultiDiscrete or"
        f" MultiBinary with one row) or a row of numbers (Box), found {space} in {name}."
    )
