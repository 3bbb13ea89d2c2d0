"""What an individual has achieved: the behaviour of section 2.3.3 and the fitness of Eq. (1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from islandgp.island.episode import Episode
from islandgp.island.journal import Event
from islandgp.scoring.rewards import Multipliers, Rewards, components


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of evaluating one tree: of one episode, or the mean of several (`combine`)."""

    fitness: float  # points, Eq. (1)
    components: tuple[float, ...]  # points by scoring.rewards.Component; their sum is the fitness
    pickups: float  # direct garbage pickups
    interactions: float  # humanoid interactions
    deliveries: float  # clearing deliveries with something to unload
    charges: float  # charging attempts
    gathered: float  # items picked up or taken over
    delivered: float  # items unloaded
    collisions: float  # with humanoids
    distance: float  # m driven
    inactive: float  # s since the last non-movement action
    laps: float  # patrol rounds
    battery: float  # % at the end
    seconds: float  # simulated s
    endings: tuple[str, ...]  # why each episode ended


def outcome(
    episode: Episode, rewards: Rewards, stage: Multipliers, *, seconds_per_step: float
) -> Outcome:
    """One episode's outcome."""
    counts = dict.fromkeys(Event, 0.0)
    sums = dict.fromkeys(Event, 0.0)
    for _, event, amount in episode.events:
        counts[event] += 1
        sums[event] += amount
    parts = components(rewards, stage, episode.events)
    return Outcome(
        fitness=sum(parts),
        components=parts,
        pickups=counts[Event.PICKUP],
        interactions=counts[Event.INTERACTION],
        deliveries=counts[Event.DELIVERY],
        charges=counts[Event.CHARGE],
        gathered=sums[Event.PICKUP] + sums[Event.INTERACTION],
        delivered=sums[Event.DELIVERY],
        collisions=counts[Event.COLLISION],
        distance=episode.distance,
        inactive=episode.inactive,
        laps=float(episode.laps),
        battery=episode.battery,
        seconds=episode.steps * seconds_per_step,
        endings=(episode.ending.value,),
    )


def combine(outcomes: Sequence[Outcome]) -> Outcome:
    """The mean of several episodes, number by number; one episode's outcome is itself."""
    if len(outcomes) == 1:
        return outcomes[0]
    n = len(outcomes)

    def mean(name: str) -> float:
        return float(sum(getattr(o, name) for o in outcomes)) / n

    return Outcome(
        components=tuple(
            sum(column) / n for column in zip(*(o.components for o in outcomes), strict=True)
        ),
        endings=tuple(e for o in outcomes for e in o.endings),
        **{name: mean(name) for name in Outcome.__slots__ if name not in ("components", "endings")},
    )
