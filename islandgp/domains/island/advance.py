"""Time passing: the physics steps between two looks, with the script's cues on the way."""

from __future__ import annotations

from math import hypot

from islandgp.domains.island import engine
from islandgp.domains.island.events import Event
from islandgp.domains.island.robot import steps_to
from islandgp.domains.island.sensing import sense
from islandgp.domains.island.state import State
from islandgp.domains.island.world import FAR


def advance(island: State, until: int) -> None:
    """Moves the island to step `until`, or to the first step where something has changed.

    The script's cues are played on the way, and who is due looks. A contact, an
    action that may find new garbage, and a look that shows something new end it.
    """
    physics, ground, people, dt = island.physics, island.ground, island.humanoids, island.dt
    touching, turns = physics.contacts.touching, island.script.turns
    step, turn, shaken = island.step, turns[island.turn][0], island.shaken
    spawn = _next_spawn(island) if ground.room > 0 else FAR
    if shaken:
        until = step + 1
    while step < until:
        look = ground.due if ground.due < people.due else people.due
        stop = turn if turn < until else until
        if spawn < stop:
            stop = spawn
        if look < stop:
            stop = look if look > step else step + 1
        step = island.step = step + physics.run(stop - step, dt)
        if touching or shaken:
            island.shaken = bool(touching)
            _touch(island)
        if step == spawn:
            spawn = _spawn(island)
        if step == turn:
            turn = _turn(island)
        if step >= island.wake:
            return
        if step < until and (step >= ground.due or step >= people.due) and sense(island):
            return


def _touch(island: State) -> None:
    """Counts new collisions with humanoids; whoever is touched steps aside."""
    contacts, robot = island.physics.contacts, island.robot
    for _ in contacts.begun:
        island.log(Event.COLLISION, 1)
    contacts.begun.clear()
    here, positions = island.physics.robot_position(), island.physics.humanoid_positions()
    for h in sorted(contacts.touching):
        if h >= 0:
            island.humanoids.step_aside(h, positions[h], here)
    robot.leg_end = island.step  # the wheels are set anew
    robot.rolling = True
    island.ground.due = island.wake = island.step
    island.humanoids.look_at_all(island.step)


def _next_spawn(island: State) -> int:
    """The step at which the next item appears; those for which there was no room are over."""
    spawns, step, i = island.script.spawns, island.step, island.spawn
    while spawns[i][0] <= step:
        i += 1
    island.spawn = i
    return spawns[i][0]


def _spawn(island: State) -> int:
    """This step's garbage appears. Returns the next step at which some does."""
    spawns = island.script.spawns
    at, x, y = spawns[island.spawn]
    while at == island.step and island.ground.room > 0:
        island.ground.drop(x, y)
        _notice(island, x, y)
        island.spawn += 1
        at, x, y = spawns[island.spawn]
    return at if island.ground.room > 0 else FAR


def _turn(island: State) -> int:
    """This step's humanoids turn. Returns the next step at which one does."""
    turns = island.script.turns
    at, h, vx, vy = turns[island.turn]
    while at == island.step:
        island.humanoids.turn(h, vx, vy, at)
        island.turn += 1
        at, h, vx, vy = turns[island.turn]
    return at


def _notice(island: State, x: float, y: float) -> None:
    """New garbage may be the next thing that comes into sight."""
    robot, ground = island.robot, island.ground
    at = engine.position(robot.body)
    gap = hypot(x - at.x, y - at.y) - robot.settings.perception
    seen = island.step
    if gap > 0:
        seen += steps_to(gap, robot.stride)
    else:
        island.wake = seen  # an action may find it though the blackboard stays the same
    if seen < ground.due:
        ground.due = seen
