"""Time passing: the physics steps between two looks, with the script's cues on the way."""

from __future__ import annotations

from math import hypot

from islandgp.island import engine
from islandgp.island.journal import Event
from islandgp.island.robot import steps_to
from islandgp.island.script import SPAWN
from islandgp.island.sensing import sense
from islandgp.island.state import Island


def advance(island: Island, until: int) -> None:
    """Moves the island to step `until`, or to the first step where something has changed.

    The script's cues are played on the way, and who is due looks. A contact, an
    action that may find new garbage, and a look that shows something new end it.
    """
    physics, ground, people, dt = island.physics, island.ground, island.humanoids, island.dt
    touching, cues = physics.contacts.touching, island.script.cues
    step, cue, shaken = island.step, cues[island.cue][0], island.shaken
    if shaken:
        until = step + 1
    while step < until:
        look = ground.due if ground.due < people.due else people.due
        stop = cue if cue < until else until
        if look < stop:
            stop = look if look > step else step + 1
        step = island.step = step + physics.run(stop - step, dt)
        if touching or shaken:
            island.shaken = bool(touching)
            _touch(island)
        if step == cue:
            cue = _play_cues(island, step)
        if step >= island.wake:
            return
        if step < until and (step >= ground.due or step >= people.due) and sense(island):
            return


def _touch(island: Island) -> None:
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


def _play_cues(island: Island, step: int) -> int:
    """This step's cues happen: garbage appears, humanoids turn. Returns the next one's step."""
    cues, i = island.script.cues, island.cue
    at, who, a, b = cues[i]
    while at == step:
        if who != SPAWN:
            island.humanoids.turn(who, a, b, step)
        elif island.ground.drop(a, b):
            _notice(island, a, b)
        i += 1
        at, who, a, b = cues[i]
    island.cue = i
    return at


def _notice(island: Island, x: float, y: float) -> None:
    """New garbage may be the next thing that comes into sight."""
    robot, ground = island.robot, island.ground
    at = engine.position(robot.body)
    gap = hypot(x - at.x, y - at.y) - robot.settings.perception
    seen = island.step + (steps_to(gap, robot.stride) if gap > 0 else 0)
    if seen >= ground.due:
        return
    ground.due = seen
    if gap <= 0:
        island.wake = island.step  # an action may find it though the blackboard stays the same
