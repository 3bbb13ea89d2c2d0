"""An episode: one robot with one tree on one day of the island (section 2.2.2).

Time advances in steps of a tenth of a second. Each part reports the next step at which it can
change something; until the first of these only the physics engine is stepped. `stepwise=True`
checks all parts in every step instead; the outcome is equal to the last bit.

`advance` runs the physics steps between two checks, with the events of the schedule.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from math import hypot

from islandgp.bt.core.engine import compile_tree
from islandgp.bt.core.kinds import needs_each_tick
from islandgp.bt.core.node import AGAIN, RUNNING, Node, compares_keys, thresholds, walk
from islandgp.domains.island import engine
from islandgp.domains.island.actions import ACTIONS, IslandAction
from islandgp.domains.island.compiled import Crowded, compiled_for
from islandgp.domains.island.events import Award, IslandEvent
from islandgp.domains.island.layout import BEFORE_MOVING
from islandgp.domains.island.outcome import Ending, Episode
from islandgp.domains.island.robot import MICRO, steps_to
from islandgp.domains.island.sensing import look_for_garbage, refresh, sense, visit_left
from islandgp.domains.island.state import State, build_island
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.domains.island.world import FAR, IslandWorld
from islandgp.leaves import status_of
from islandgp.sensors import Sensors


def advance(island: State, end: int) -> None:
    """Simulates until step `end`, or until the first step in which something has changed.

    Garbage appears, humanoids turn and the robot looks around as scheduled. A contact, garbage that
    an action may use, and a look that shows something new end it.
    """
    physics, ground, people, dt = island.physics, island.ground, island.humanoids, island.dt
    touching, turns = physics.contacts.touching, island.schedule.turns
    step, turn, shaken = island.step, turns[island.turn][0], island.shaken
    run = island.compiled.run if island.compiled else None
    space, step_space = physics.handle, engine.step
    spawn = FAR
    if ground.room > 0:
        spawn = island.schedule.spawns[island.spawn][0]
        if spawn <= step:
            spawn = _next_spawn(island)
    if shaken:
        end = step + 1
    while step < end:
        stop = spawn if spawn < end else end
        if run is not None:
            step = island.step = run(stop)
            turn = turns[island.turn][0]
        else:
            look = ground.next_look if ground.next_look < people.next_look else people.next_look
            if turn < stop:
                stop = turn
            if look < stop:
                stop = look if look > step else step + 1
            for step in range(step + 1, stop + 1):  # noqa: B007, B020 -- its last value counts
                step_space(space, dt)
                if touching:
                    break
            island.step = step
        if touching or shaken:
            island.shaken = bool(touching)
            _touch(island)
        if step == spawn:
            spawn = _spawn(island)
        if step == turn:
            turn = _turn(island)
        if step >= island.wake or island.changed:
            return
        if step < end and (step >= ground.next_look or step >= people.next_look) and sense(island):
            return


def _touch(island: State) -> None:
    """Counts new collisions with humanoids; those that are touched step aside."""
    contacts, robot = island.physics.contacts, island.robot
    for _ in contacts.begun:
        island.log(IslandEvent.COLLISION, 1)
    contacts.begun.clear()
    position, positions = island.physics.robot_position(), island.physics.humanoid_positions()
    for h in sorted(contacts.touching):
        if h >= 0:
            island.humanoids.step_aside(h, positions[h], position)
    robot.leg_end = island.step  # so that the wheels are set again
    robot.rolling = True
    island.ground.next_look = island.wake = island.step
    island.humanoids.look_at_all(island.step)


def _next_spawn(island: State) -> int:
    """The step in which the next item appears. Earlier items had no room and are left out."""
    spawns, step, i = island.schedule.spawns, island.step, island.spawn
    while spawns[i][0] <= step:
        i += 1
    island.spawn = i
    return spawns[i][0]


def _spawn(island: State) -> int:
    """Adds the garbage of this step; returns the next step that has some."""
    spawns = island.schedule.spawns
    at, x, y = spawns[island.spawn]
    while at == island.step and island.ground.room > 0:
        island.ground.drop(island.ground.first + island.spawn)
        _notice(island, x, y)
        island.spawn += 1
        at, x, y = spawns[island.spawn]
    return at if island.ground.room > 0 else FAR


def _turn(island: State) -> int:
    """Turns the humanoids of this step; returns the next step that has turns."""
    turns = island.schedule.turns
    at, h, vx, vy = turns[island.turn]
    while at == island.step:
        island.humanoids.turn(h, vx, vy, at)
        island.turn += 1
        at, h, vx, vy = turns[island.turn]
    return at


def _notice(island: State, x: float, y: float) -> None:
    """Moves the next look for garbage forward if new garbage may come into sight before it."""
    robot, ground = island.robot, island.ground
    at = engine.position(robot.body)
    gap = hypot(x - at.x, y - at.y) - robot.perception
    look = island.step
    if gap > 0:
        look += steps_to(gap, robot.stride)
    else:
        island.wake = look  # an action may find it though the blackboard stays the same
    if look < ground.next_look:
        ground.next_look = look


def run_episode(
    tree: Node,
    world: IslandWorld,
    seed: int,
    award: Award,
    *,
    actions: Mapping[str, IslandAction] = ACTIONS,
    stepwise: bool = False,
    watch: Callable[[int, int], None] | None = None,
    observe: Callable[[State], None] | None = None,
    sensors: Sensors | None = None,
) -> Episode:
    """Runs an episode; the outcome is a function of tree, world, seed, award and actions.

    Args:
        tree: the robot's tree.
        world: settings of the island.
        seed: of the world.
        award: component and points by event.
        actions: the robot's actions by name.
        stepwise: check every part in every step.
        watch: called with the index and status of every ticked node.
        observe: called with the island after every tick. Like `watch`, it needs `stepwise` to be
            called in each step.
        sensors: the tree reads their values in place of the true blackboard; implies `stepwise`.
    """
    stepwise = stepwise or sensors is not None
    levels = thresholds(tree, "batteryLevel")
    island = build_island(world, seed, award, levels)
    island.compiled = None if stepwise else compiled_for(island, may_coast=not (watch or observe))
    try:
        return _simulate(tree, island, actions, stepwise, watch, observe, sensors)
    except Crowded:
        island.spaces.append(island.physics)
        island = build_island(world, seed, award, levels)
        island.compiled = compiled_for(island, may_coast=False)
        return _simulate(tree, island, actions, stepwise, watch, observe, sensors)


def _simulate(
    tree: Node,
    island: State,
    actions: Mapping[str, IslandAction],
    stepwise: bool,
    watch: Callable[[int, int], None] | None,
    observe: Callable[[State], None] | None,
    sensors: Sensors | None,
) -> Episode:
    """Runs an episode from step 0 to its end; see `run_episode`."""
    bound = _bound_actions(tree, island, actions)
    board = island.board if sensors is None else list(island.board)
    tick = compile_tree(
        tree, bound, board, VOCABULARY.key_index, watch=watch, step_s=island.world.episode.step
    )
    if sensors is not None:
        tick = _sensing(tick, island.board, board, sensors)
    # Such a tree is ticked in every step; the battery is the only key that moves all the time.
    timed = needs_each_tick(tree) or compares_keys(tree, "batteryLevel")
    ticks, due, end = 0, 0, _deadline(island)
    ending: Ending | None = None
    while ending is None:
        start = island.step
        sense(island, always=stepwise)
        if island.changed or start >= due or start >= island.wake:
            next_step = _tick(island, tick) or stepwise or timed
            due = start + 1 if next_step else island.robot.battery_due(start)
            ticks += 1
            if observe is not None:
                observe(island)
        horizon = _horizon(island, min(due, end))
        advance(island, start + 1 if stepwise else horizon)
        _account(island, island.step - start)
        end = _deadline(island)
        if island.robot.battery <= 0 or island.step >= end:
            ending = _ending(island)
    return _close(island, ending, ticks)


def _sensing(
    tick: Callable[[], int], true_board: list[float], sensed_board: list[float], sensors: Sensors
) -> Callable[[], int]:
    """A tick that reads the sensors' values of the true blackboard."""

    def sensed() -> int:
        sensed_board[:] = sensors(true_board)
        return tick()

    return sensed


def _bound_actions(
    tree: Node, island: State, actions: Mapping[str, IslandAction]
) -> dict[str, Callable[[bool], int]]:
    """The actions of this island's robot.

    All leaves of one action share its goal: one that starts may change it for another that runs.
    """
    leaves = Counter(node.action for node in walk(tree) if node.action)
    checked = {
        name: action if ACTIONS.get(name) is action else partial(_checked, name, action)
        for name, action in actions.items()
    }
    return {
        name: partial(_shared, island, action) if leaves[name] > 1 else partial(action, island)
        for name, action in checked.items()
    }


def _checked(name: str, action: IslandAction, island: State, fresh: bool) -> int:
    """Calls a user's action. Raises DomainError if it returns no status."""
    return status_of(action(island, fresh), name, action)


def _shared(island: State, action: IslandAction, fresh: bool) -> int:
    island.restarted |= fresh
    return action(island, fresh)


def _tick(island: State, tick: Callable[[], int]) -> bool:
    """Ticks the tree; True if a tick in the next step may have another result.

    A tick that left its leaves running has the same result in the next step. So has one that began
    at the root and ended without changing anything, until the robot has driven so far that one of
    its actions would have another result.
    """
    robot = island.robot
    refresh(island)
    island.changed = island.acted = island.stirred = island.patrolling = island.restarted = False
    robot.driving = robot.charging = False
    island.wake = FAR
    island.free = robot.perception  # no farther: the rest is unknown
    resumed, island.status = island.status >= RUNNING, tick()
    has_ended = island.status != RUNNING
    if island.stirred or island.status == AGAIN or (resumed and (has_ended or island.restarted)):
        return True
    if not robot.driving:
        return False
    if robot.charging:  # it will lose the charger
        return True
    if has_ended:
        island.same_for(robot.same_choice())
        island.wake_at(island.step + steps_to(island.free, robot.stride))
    if robot.fined_at >= 0:
        island.wake_at(island.step + steps_to(visit_left(island), robot.stride))
    return False


def _horizon(island: State, latest: int) -> int:
    """The next step, at most `latest`, in which the state may change other than by physics."""
    ground, robot, step = island.ground, island.robot, island.step
    another_leg = robot.turn_wheels(step)
    if another_leg and ground.next_look:  # 0: look at the next step
        if island.compiled and not island.patrolling:
            ground.next_look = BEFORE_MOVING
        else:
            look_for_garbage(island)
    horizon = latest if latest < island.wake else island.wake
    if robot.driving:
        another = robot.leg_end
    elif not island.acted:
        second = island.limits.second
        another = step + second - island.idle % second
    else:
        another = FAR
    if another < horizon:
        horizon = another
    return horizon if horizon > step else step + 1


def _deadline(island: State) -> int:
    """The step in which the episode ends unless an event postpones it."""
    limits, event_log = island.limits, island.event_log
    low = island.robot.battery < limits.low_battery
    end = event_log.best_step + (limits.stagnation_low_battery if low else limits.stagnation)
    if event_log.negative_since >= 0:
        end = min(end, event_log.negative_since + limits.negative)
    return end if end < limits.length else limits.length


def _account(island: State, steps: int) -> None:
    """Accounts for the last `steps` steps. A robot that neither drives nor acts is idle."""
    robot = island.robot
    robot.spend(steps)
    island.booked = island.step
    if island.patrolling:
        island.patrol_steps += steps
    if island.acted:
        island.last_action = island.step
    if robot.driving or island.acted:
        island.idle = 0
        return
    island.idle += steps
    if island.idle % island.limits.second == 0:
        island.log(IslandEvent.IDLE, island.idle / island.limits.second)


def _ending(island: State) -> Ending:
    """The reason for the end of the episode."""
    if island.robot.battery <= 0:
        island.log(IslandEvent.SHUTDOWN, 1)
        return Ending.SHUTDOWN
    if island.step >= island.limits.length:
        return Ending.TIME
    start, limit = island.event_log.negative_since, island.limits.negative
    return Ending.NEGATIVE if 0 <= start <= island.step - limit else Ending.STAGNATION


def _close(island: State, ending: Ending, ticks: int) -> Episode:
    island.log(IslandEvent.LEFTOVER, island.ground.count)
    island.spaces.append(island.physics)
    step = island.world.episode.step
    return Episode(
        events=tuple(island.event_log.events),
        steps=island.step,
        ending=ending,
        fitness=island.event_log.fitness,
        points=island.event_log.points,
        battery=max(0, island.robot.battery) / MICRO,
        distance=island.robot.odometer * island.robot.stride,
        inactive=(island.step - island.last_action) * step,
        laps=island.robot.laps,
        ticks=ticks,
    )
