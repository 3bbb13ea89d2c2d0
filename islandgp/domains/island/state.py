"""The state of the island in an episode; the only mutable object of a simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from islandgp.bt.core.node import FAILURE
from islandgp.domains.island.events import Award, IslandEvent, IslandEventLog
from islandgp.domains.island.garbage import Ground
from islandgp.domains.island.humanoids import Humanoids
from islandgp.domains.island.robot import MICRO, IslandRobot
from islandgp.domains.island.schedule import Schedule, draw_schedule
from islandgp.domains.island.space import Space, build_space, idle_spaces
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import FAR, EpisodeSettings, IslandWorld

if TYPE_CHECKING:
    from islandgp.domains.island.compiled import Compiled


@dataclass(frozen=True, slots=True)
class Deadlines:
    """Limits of an episode in steps (section 2.2.2)."""

    length: int
    stagnation: int
    stagnation_low_battery: int
    low_battery: int  # millionths of a percent
    negative: int
    second: int  # steps in one second

    @staticmethod
    def of(settings: EpisodeSettings) -> Deadlines:
        """The limits of the settings, in steps."""
        seconds = (settings.length, settings.stagnation, settings.stagnation_low_battery)
        length, stagnation, longer = (max(1, round(s / settings.step)) for s in seconds)
        low, negative = (
            round(settings.low_battery * MICRO),
            round(settings.negative / settings.step),
        )
        return Deadlines(
            length, stagnation, longer, low, negative, max(1, round(1 / settings.step))
        )


@dataclass(slots=True)
class State:
    """Everything that a tick can read or change."""

    world: IslandWorld
    limits: Deadlines
    schedule: Schedule
    physics: Space
    robot: IslandRobot
    ground: Ground
    humanoids: Humanoids
    event_log: IslandEventLog
    spaces: list[Space]  # to which `physics` returns at the end
    board: list[float]  # the blackboard, in the order of VOCABULARY
    dt: float  # s a step
    walk: float  # m that a humanoid moves in a step, at most
    step: int = 0
    booked: int = 0  # the step up to which time is accounted for
    changed: bool = False  # a flag of the blackboard, since the last tick
    spawn: int = 0  # index of the schedule's next garbage
    turn: int = 0  # index of the schedule's next turn of a humanoid
    wake: int = FAR  # a step at which the tree has to be ticked
    free: float = 0.0  # m to drive until a fresh call of the last tick's action has another result
    shaken: bool = False  # had a contact a step ago; the engine may still separate bodies
    status: int = FAILURE  # of the tree's last tick
    stirred: bool = False  # this tick changed something on which the next may depend
    restarted: bool = False  # a leaf started in this tick whose action other leaves share
    acted: bool = False  # a non-movement action happened in this tick
    idle: int = 0  # steps of idleness so far
    last_action: int = 0  # step of the last non-movement action
    patrolling: bool = False  # PatrolWaypoint drives the robot
    patrol_steps: int = 0  # steps of patrol so far
    rewarded_segment: int = -1  # last stretch of patrol that had a discovery
    item: int = -1  # garbage that MoveToGarbage drives to
    humanoid: int = -1  # humanoid that MoveToHumanoid drives to
    aim_end: int = 0  # step at which it updates its aim
    compiled: Compiled | None = None  # functions in place of Python's
    aim_x: float = 0.0  # m, where it saw that humanoid
    aim_y: float = 0.0

    def log(self, event: IslandEvent, amount: float) -> None:
        """Records an event of this step."""
        self.event_log.log(self.step, event, amount)

    def act(self, event: IslandEvent, amount: float) -> None:
        """Records a non-movement action with its event."""
        self.log(event, amount)
        self.acted = self.stirred = True
        self.last_action = self.step

    def wake_at(self, step: int) -> None:
        """Requests a tick at `step` at the latest."""
        if step < self.wake:
            self.wake = step

    def same_for(self, metres: float) -> None:
        """Declares that a fresh call of the action has the same result for the next `metres`.

        Changes of the blackboard, the load and garbage in sight are detected anyway.
        """
        if metres < self.free:
            self.free = metres


def build_island(
    world: IslandWorld, seed: int, award: Award, thresholds: tuple[float, ...]
) -> State:
    """Builds the island at step 0.

    Args:
        world: settings of the island.
        seed: of the world.
        award: component and points by event.
        thresholds: battery levels in percent that the tree compares with.
    """
    schedule = draw_schedule(world, seed)
    spaces = idle_spaces(world, schedule.obstacles, len(schedule.humanoids))
    try:
        physics = spaces.pop()
        physics.reset(world, schedule)
    except IndexError:
        physics = build_space(world, schedule)
    robot = IslandRobot(world, physics.robot, schedule.obstacles, thresholds)
    walk = world.humanoids.speed * world.episode.step
    # The engine pushes a humanoid out of walls and rocks by less than the depth of the overlaps.
    pushed = 2 * max(0.0, walk - physics.space.collision_slop)
    return State(
        world=world,
        limits=Deadlines.of(world.episode),
        schedule=schedule,
        physics=physics,
        robot=robot,
        ground=Ground(schedule, most=world.garbage.most, side=world.side, cell=world.cell),
        humanoids=Humanoids(world.humanoids, physics.humanoids),
        event_log=IslandEventLog(award),
        spaces=spaces,
        board=[0.0] * len(VOCABULARY.keys),
        dt=world.episode.step,
        walk=walk + pushed,
    )
