"""Sensors of perturbed worlds: noise and delay of the blackboard.

A domain declares the noise of its numbers (`Key.noise`) and the longest delay of its blackboard in
ticks (`Schema.delay`); the configuration sets the amount of both (`perturb`).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from islandgp.bt.core.vocabulary import Key
from islandgp.seeding import Rng, Stream, stream


@dataclass(frozen=True, slots=True)
class SensorFaults:
    """Amount of noise and delay of sensors."""

    noise: float  # multiple of the standard deviations that the keys declare, >= 0
    delay: int  # ticks at most, >= 0; each world has a delay between 0 and this

    def sensors(self, keys: Mapping[str, Key], seed: int) -> Sensors:
        """The sensors of an episode in the world of a seed."""
        return Sensors(self, keys, stream(seed, Stream.PERTURBATION, slot=1))


class Sensors:
    """The sensors of one episode; called once per tick."""

    def __init__(self, faults: SensorFaults, keys: Mapping[str, Key], rng: Rng) -> None:
        """`rng` is consumed, here and in each tick."""
        self._rng = rng
        self._noisy = [
            (place, faults.noise * key.noise, *key.bounds, round if key.whole else float)
            for place, key in enumerate(keys.values())
            if faults.noise * key.noise > 0
        ]
        self._delay = int(rng.integers(faults.delay + 1))
        self._past: deque[list[float]] = deque(maxlen=self._delay + 1)

    def __call__(self, values: Sequence[float]) -> list[float]:
        """The values that the tree reads in the next tick, from the true `values`, by key index.

        Numbers are clipped to the ranges of their keys, and whole numbers are rounded. During the
        initial delay, the tree reads the first values.
        """
        sensed = [float(value) for value in values]
        if self._noisy:
            draws = self._rng.standard_normal(len(self._noisy)).tolist()
            for (place, sd, low, most, kind), draw in zip(self._noisy, draws, strict=True):
                sensed[place] = min(max(float(kind(sensed[place] + sd * draw)), low), most)
        self._past.append(sensed)
        return self.values

    @property
    def values(self) -> list[float]:
        """The values that the tree read in the last tick."""
        return self._past[0]
