"""The spaces of an environment: observations as a row of numbers, and actions from numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
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
    observed: int  # number of values in an observation
    act: Callable[[Any], Any] | None  # (list of numbers) -> action; None: an action is a number
    none: int | tuple[float, ...]  # the first of each choice, or zeros
    choices: tuple[range, ...] = ()  # the values of each choice; empty: of a Box
    bounds: tuple[tuple[float, float], ...] = ()  # of each number of a Box
    whole: tuple[bool, ...] = ()  # of each value in an observation: True for a whole number

    @classmethod
    def of(cls, env: Any, name: str) -> Spaces:
        """The spaces of an environment. Raises ConfigError for spaces that cannot be used."""
        read, paths = _observations(env.observation_space, name)
        places: dict[int | str, int] = {path: at for at, path in enumerate(paths) if path}
        places |= {at: at for at in range(len(paths))}
        whole = tuple(_whole(env.observation_space))
        return cls(read, places, len(paths), *_actions(env.action_space, name), whole)

    def named(self) -> str:
        """The places of an observation as text."""
        names = [place for place in self.places if isinstance(place, str)]
        return f"0 to {self.observed - 1}" + (f" or one of {', '.join(names)}" if names else "")

    def fault(self, action: int | tuple[float, ...]) -> str:
        """A text on the expected actions if an action is not one of the environment; else ""."""
        if self.bounds:
            expected = f"a list of {len(self.bounds)} numbers"
            if isinstance(action, int) or len(action) != len(self.bounds):
                return expected
            within = (
                low <= each <= high for each, (low, high) in zip(action, self.bounds, strict=True)
            )
            return "" if all(within) else f"{expected} within {[*map(list, self.bounds)]}"
        if isinstance(self.none, int):
            (values,) = self.choices
            fits = isinstance(action, int) and action in values
            return "" if fits else f"{values[0]} to {values[-1]}"
        ranges = ", ".join(f"{values[0]} to {values[-1]}" for values in self.choices)
        expected = f"a list of {len(self.choices)} whole numbers ({ranges})"
        if isinstance(action, int) or len(action) != len(self.choices):
            return expected
        fits = all(n in values for n, values in zip(action, self.choices, strict=True))
        return "" if fits else expected


def _observations(space: Any, name: str) -> tuple[Read, list[str]]:
    """A function that reads an observation, and the paths of its numbers ("" if they have none)."""
    kind = type(space).__name__
    if kind == "Discrete":
        return lambda value: [float(value)], [""]
    if kind in ("MultiDiscrete", "MultiBinary") or (kind == "Box" and len(space.shape) == 1):
        if space.dtype.kind == "f":
            read: Read = methodcaller("tolist")
        else:
            read = lambda values: values.ravel().astype(float).tolist()  # noqa: E731
        count = 1
        for length in space.shape:
            count *= length
        return read, [""] * count
    if kind == "Dict":
        parts = {key: _observations(inside, name) for key, inside in space.spaces.items()}

        def joined_numbers(observation: Any) -> list[float]:
            return [number for key, (read, _) in parts.items() for number in read(observation[key])]

        return joined_numbers, [
            _path(key, at, inside)
            for key, (_, inside) in parts.items()
            for at in range(len(inside))
        ]
    if kind == "Tuple":
        rows = [_observations(inside, name) for inside in space.spaces]

        def numbers_of_parts(observation: Any) -> list[float]:
            pairs = zip(rows, observation, strict=True)
            return [number for (read, _), part in pairs for number in read(part)]

        return numbers_of_parts, [""] * sum(len(paths) for _, paths in rows)
    raise ConfigError(
        f"world.environment: expected observations that are numbers (a Box with one row, Discrete,"
        f" MultiDiscrete, MultiBinary, or a Dict or Tuple of them), found {space} in {name}."
    )


def _whole(space: Any) -> Iterator[bool]:
    """For each number of an observation, in order: True for a whole number."""
    kind = type(space).__name__
    if kind in ("Dict", "Tuple"):
        for inside in space.spaces.values() if kind == "Dict" else space.spaces:
            yield from _whole(inside)
    elif kind == "Discrete":
        yield True
    else:
        yield from [space.dtype.kind != "f"] * prod(space.shape)


def _path(key: str, at: int, inside: Sequence[str]) -> str:
    """`key` for the only number of a key, else `key.place`."""
    if len(inside) == 1 and not inside[0]:
        return key
    return f"{key}.{inside[at] or at}"


def _actions(
    space: Any, name: str
) -> tuple[
    Callable[[Any], Any] | None,
    int | tuple[float, ...],
    tuple[range, ...],
    tuple[tuple[float, float], ...],
]:
    """A function that makes an action, the default action, and choices and bounds of `Spaces`."""
    kind = type(space).__name__
    if kind == "Discrete":
        first = int(space.start)
        return None, first, (range(first, first + int(space.n)),), ()
    if kind in ("MultiDiscrete", "MultiBinary") and len(space.shape) == 1:
        choices = _choices(space)
        return _row(space.dtype), tuple(float(values[0]) for values in choices), choices, ()
    if kind == "Box" and len(space.shape) == 1:
        bounds = tuple(zip(space.low.tolist(), space.high.tolist(), strict=True))
        zeros = tuple(min(high, max(low, 0.0)) for low, high in bounds)
        return _row(space.dtype), zeros, (), bounds
    raise ConfigError(
        f"world.environment: expected actions to choose from (Discrete, or MultiDiscrete or"
        f" MultiBinary with one row) or a row of numbers (Box), found {space} in {name}."
    )


def _choices(space: Any) -> tuple[range, ...]:
    """The values of each choice of a MultiDiscrete or MultiBinary space with one row."""
    if type(space).__name__ == "MultiBinary":
        return (range(2),) * int(space.shape[0])
    pairs = zip(space.start.tolist(), space.nvec.tolist(), strict=True)
    return tuple(range(first, first + count) for first, count in pairs)


def _row(dtype: Any) -> Callable[[Any], Any]:
    import numpy as np

    return lambda action: np.array(action, dtype)
