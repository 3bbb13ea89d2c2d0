"""Time passing: the physics steps between two looks, with the script's cues on the way."""

from __future__ import annotations

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
    cues, physics, ground, people = (
        island.script.cues,
        island.physics,
        island.ground,
        island.humanoids,
    )
    touching, dt = physics.contacts.touching, island.world.episode.step
    step, shaken = island.step, island.shaken
    if shaken:
        until = step + 1
    while step < until:
        stop = max(step + 1, min(until, cues[island.cue][0], ground.due, people.due))
        step = island.step = step + physics.run(stop - step, dt)
        if touching or shaken:
            island.shaken = bool(touching)
            _touch(island)
        if step == cues[island.cue][0]:
            _play_cues(island)
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


def _play_cues(island: Island) -> None:
    """This step's cues happen: garbage appears, humanoids turn."""
    cues, people = island.script.cues, island.humanoids
    while cues[island.cue][0] == island.step:
        _, who, a, b = cues[island.cue]
        island.cue += 1
        if who == SPAWN:
            if island.ground.drop(a, b):
                _notice(island, complex(a, b))
        elif people.turn(who, (a, b)):
            people.look_at(who, island.step)


def _notice(island: Island, item: complex) -> None:
    """New garbage may be the next thing that comes into sight."""
    robot, ground = island.robot, island.ground
    gap = abs(item - island.physics.robot_position()) - robot.settings.perception
    seen = island.step + (steps_to(gap, robot.stride) if gap > 0 else 0)
    if seen >= ground.due:
        return
    ground.due = seen
    if gap <= 0:
        island.wake = island.step  # an action may find it though the blackboard stays the same
