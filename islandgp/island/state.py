"""One episode's island as it is now: the single mutable thing of a simulation."""

from __future__ import annotations

from dataclasses import dataclass

from islandgp.bt.node import FAILURE, KEYS
from islandgp.island.garbage import Ground, Item
from islandgp.island.humanoids import Humanoids
from islandgp.island.journal import Award, Event, Journal
from islandgp.island.robot import FAR, MICRO, Robot
from islandgp.island.script import write_script
from islandgp.island.space import build_space
from islandgp.island.world import EpisodeSettings, World


@dataclass(frozen=True, slots=True)
class Limits:
    """When an episode ends, in steps (section 2.2.2)."""

    length: int
    stagnation: int
    stagnation_low_battery: int
    low_battery: int  # millionths of a percent
    negative: int
    second: int  # steps in one second

    @staticmethod
    def of(settings: EpisodeSettings) -> Limits:
        """The settings' seconds as steps."""
        seconds = (settings.length, settings.stagnation, settings.stagnation_low_battery)
        length, stagnation, longer = (max(1, round(s / settings.step)) for s in seconds)
        low, negative = (
            round(settings.low_battery * MICRO),
            round(settings.negative / settings.step),
        )
        return Limits(length, stagnation, longer, low, negative, max(1, round(1 / settings.step)))


class Island:
    """Everything that a tick can see or change."""

    def __init__(
        self, world: World, seed: int, award: Award, thresholds: tuple[float, ...]
    ) -> None:
        self.world = world
        self.limits = Limits.of(world.episode)
        self.script = write_script(world, seed)
        self.physics = build_space(world, self.script)
        self.robot = Robot(world, self.physics.robot, self.script.obstacles, thresholds)
        self.ground = Ground(
            self.script.garbage,
            most=world.garbage.most,
            side=world.side,
            cell=world.robot.perception + 2 * self.robot.stride,  # may be left by a step
        )
        self.humanoids = Humanoids(world.humanoids, self.physics.humanoids)
        self.dt = world.episode.step  # s
        self.walk = world.humanoids.speed * world.episode.step  # m a step
        self.journal = Journal(award)
        self.board = [0.0] * len(KEYS)  # the blackboard, in the order of KEYS
        self.step = 0
        self.booked = 0  # step until which time is in the account
        self.changed = False  # a flag of the blackboard, since the last tick
        self.cue = 0  # index of the next cue of the script
        self.wake = FAR  # a step at which a running action wants to be ticked
        self.shaken = False  # touched a step ago: the engine still moves overlapping bodies apart
        self.status = FAILURE  # of the tree's last tick
        self.stirred = False  # this tick changed something that the next one can depend on
        self.acted = False  # a non-movement action happened in this tick
        self.idle = 0  # steps of idleness so far
        self.last_action = 0  # step of the last non-movement action
        self.patrolling = False  # PatrolWaypoint drives the robot
        self.patrol_steps = 0  # steps of patrol so far
        self.rewarded_segment = -1  # last stretch of patrol that had a discovery
        self.item: Item | None = None  # garbage that MoveToGarbage drives to
        self.humanoid = -1  # whom MoveToHumanoid drives to
        self.aim_end = 0  # step at which it aims anew
        self.aim = 0j  # where it saw that humanoid, x + iy in metres

    def log(self, event: Event, amount: float) -> None:
        """Writes an event of this step down."""
        self.journal.log(self.step, event, amount)

    def act(self, event: Event, amount: float) -> None:
        """A non-movement action with its event."""
        self.log(event, amount)
        self.acted = self.stirred = True
        self.last_action = self.step

    def wake_at(self, step: int) -> None:
        """Asks for a tick at `step` at the latest."""
        if step < self.wake:
            self.wake = step
