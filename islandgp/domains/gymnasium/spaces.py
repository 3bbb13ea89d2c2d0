"""The spaces of an environment: observations as a row of numbers, and actions from numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import methodcaller
from typing import Any

from islandgp.errors import ConfigError

Read = Callable[[Any], list[float]]


@dataclass(frozen=True)
class Spaces:
    """Conversion of an environment's observations and actions."""

    read: Read  # an observation as its numbers
    places: Mapping[int | str, int]  # their indices, by place and, of a Dict, by `key.place`
    observed: int  # numbers of an observation
    act: Callable[[Any], Any] | None  # an action from a list of numbers; None: it is a number
    none: int | tuple[float, ...]  # the action 0, or zeros
    counts: tuple[int, ...] = ()  # actions to choose from, of each choice; empty: of a Box
    bounds: tuple[tuple[float, float], ...] = ()  # of a Box: of each number

    @classmethod
    def of(cls, env: Any, name: str) -> Spaces:
        """The spaces of an environment. Raises ConfigError for spaces that cannot be used."""
        read, paths = _observations(env.observation_space, name)
        places: dict[int | str, int] = {path: at for at, path in enumerate(paths) if path}
        places |= {at: at for at in range(len(paths))}
        return cls(read, places, len(paths), *_actions(env.action_space, name))

    def named(self) -> str:
        """The places of an observation, in words."""
        words = [place for place in self.places if isinstance(place, str)]
        return f"0 to {self.observed - 1}" + (f" or one of {', '.join(words)}" if words else "")

    def fault(self, action: int | tuple[float, ...]) -> str:
        """A text on the expected actions if an action is not one of the environment; else ""."""
        if self.bounds:
            whole = f"a list of {len(self.bounds)} numbers"
            if isinstance(action, int) or len(action) != len(self.bounds):
                return whole
            within = (
                low <= each <= high for each, (low, high) in zip(action, self.bounds, strict=True)
            )
            return "" if all(within) else f"{whole} within {[*map(list, self.bounds)]}"
        if isinstance(self.none, int):
            fits = isinstance(action, int) and action < self.counts[0]
            return "" if fits else f"0 to {self.counts[0] - 1}"
        whole = f"a list of {len(self.counts)} whole numbers below {[*self.counts]}"
        if isinstance(action, int) or len(action) != len(self.counts):
            return whole
        below = (0 <= n < most and n == int(n) for n, most in zip(action, self.counts, strict=True))
        return "" if all(below) else whole


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

        def both(observation: Any) -> list[float]:
            return [number for key, (read, _) in parts.items() for number in read(observation[key])]

        return both, [
            _path(key, at, inside)
            for key, (_, inside) in parts.items()
            for at in range(len(inside))
        ]
    raise ConfigError(
        f"world.environment: expected observations that are numbers (a Box with one row, Discrete,"
        f" MultiDiscrete, MultiBinary, or a Dict of them), found {space} in {name}."
    )


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
    tuple[int, ...],
    tuple[tuple[float, float], ...],
]:
    """A function that makes an action, the zero action, and the counts and bounds of `Spaces`."""
    kind = type(space).__name__
    if kind == "Discrete" and space.start == 0:
        return None, 0, (int(space.n),), ()
    if kind == "MultiDiscrete" and len(space.shape) == 1:
        counts = tuple(map(int, space.nvec))
        return _row(space.dtype), (0.0,) * len(counts), counts, ()
    if kind == "Box" and len(space.shape) == 1:
        bounds = tuple(zip(space.low.tolist(), space.high.tolist(), strict=True))
        zeros = tuple(min(high, max(low, 0.0)) for low, high in bounds)
        return _row(space.dtype), zeros, (), bounds
    raise ConfigError(
        f"world.environment: expected actions to choose from (Discrete, MultiDiscrete) or a row of"
        f" numbers (Box), found {space} in {name}."
    )


def _row(dtype: Any) -> Callable[[Any], Any]:
    import numpy as np

    return lambda action: np.array(action, dtype)
