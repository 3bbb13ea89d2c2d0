"""Time passing: the physics steps between two looks, with the script's cues on the way."""

from __future__ import annotations

from islandgp.island.journal import Event
from islandgp.island.script import SPAWN
from islandgp.island.state import Island


def advance(island: Island, until: int) -> None:
    """Moves the island to step `until`, or to the first step where somebody must look.

    The robot touching something, garbage appearing in sight and a humanoid
    that begins to ask all want a look at once.
    """
    cues, contacts = island.script.cues, island.physics.contacts
    physics_step, dt = island.physics.space.step, island.world.episode.step
    touching, begun = contacts.touching, contacts.begun
    step = island.step
    while step < until:
        stop = min(until, cues[island.cue][0])
        while step < stop:
            physics_step(dt)
            step += 1
            if touching or begun:
                break
        island.step = step
        if touching or begun:
            _touch(island)
            until = step
        if step == cues[island.cue][0]:
            _play_cues(island)
            if min(island.ground.due, island.humanoids.due) <= step:
                return


def _touch(island: Island) -> None:
    """Counts new collisions with humanoids; whoever is touched steps aside."""
    contacts, robot = island.physics.contacts, island.robot
    for _ in contacts.begun:
        island.log(Event.COLLISION, 1)
    contacts.begun.clear()
    x, y = robot.body.position
    for h in sorted(contacts.touching):
        if h >= 0:
            island.humanoids.step_aside(h, x, y)
    robot.leg_end = island.step  # the wheels are set anew
    robot.rolling = True
    island.ground.due = island.humanoids.due = island.step


def _play_cues(island: Island) -> None:
    """Lets this step's cues happen: garbage appears, humanoids turn."""
    cues, ground, people = island.script.cues, island.ground, island.humanoids
    while cues[island.cue][0] == island.step:
        _, who, a, b = cues[island.cue]
        island.cue += 1
        if who != SPAWN:
            if people.turn(who, a, b):
                people.due = island.step
        elif ground.drop(complex(a, b)):
            _notice(island, complex(a, b))


def _notice(island: Island, item: complex) -> None:
    """New garbage may be the next thing that comes into sight."""
    robot = island.robot
    x, y = robot.body.position
    gap = abs(item - complex(x, y)) - robot.settings.perception
    island.ground.due = min(island.ground.due, island.step + max(0, int(gap / robot.stride)))
