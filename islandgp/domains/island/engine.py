"""The compiled functions that Python calls: an action, and the time between two ticks.

Time advances in steps of a tenth of a second. Each part reports the next step at which it can
change something; until the first of these only the bodies are moved. With `stepwise` all parts
are checked in every step instead; the outcome is equal to the last bit.

numba keeps the machine code in the package's `__pycache__`, or in the user's cache if that folder
cannot be written.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import numpy as np
import pymunk
from numba import njit

from islandgp.bt.core.node import AGAIN
from islandgp.domain import RUNNING
from islandgp.domains.island import behaviour
from islandgp.domains.island.chipmunk import steer
from islandgp.domains.island.events import COLLISION, IDLE
from islandgp.domains.island.fields import HUMANOID, ITEM, TURN
from islandgp.domains.island.memory import compiled, norm, table
from islandgp.domains.island.motion import (
    battery_due,
    choice_holds_for,
    move,
    result_holds_for,
    spend,
    steps_to,
    straight_on,
    touches,
    turn_wheels,
    wake_at,
)
from islandgp.domains.island.sensing import log, look_for_garbage, refresh, sense, visit_left
from islandgp.domains.island.world import FAR

START, TICKED, ACCOUNTED = range(3)  # phases in which Python calls `proceed`
TICK, COUNT, ENDED, CROWDED = range(4)  # what Python has to do next


@compiled
def after_tick(s, status):
    """Sets the step of the next tick: the next one if its result may differ.

    A tick that left its leaves running has the same result in the next step. So has one that began
    at the root and ended without changing anything, until the robot has driven so far that one of
    its actions would have another result.
    """
    ended = status != RUNNING
    again = s.world_changed or status == AGAIN or (s.resumed and (ended or s.restarted))
    if s.driving and not again:
        again = s.charging  # it will lose the charger
        if not again:
            if ended:
                result_holds_for(s, choice_holds_for(s))
                wake_at(s, s.step + steps_to(s.free_distance, s.stride))
            if s.fined_at >= 0:
                wake_at(s, s.step + steps_to(visit_left(s), s.stride))
    s.status = status
    s.due = s.step + 1 if again or s.stepwise or s.timed else battery_due(s)


@compiled
def before_tick(s):
    """Updates the blackboard, and forgets what the last tick wished."""
    refresh(s)
    s.changed = s.acted = s.world_changed = s.patrolling = s.restarted = s.driving = s.charging = 0
    s.resumed = s.status >= RUNNING
    s.ticks += 1
    s.wake, s.free_distance = FAR, s.perception  # no farther: the rest is unknown


@compiled
def horizon(s):
    """The next step, at most `due` and `end`, in which the state may change by more than physics.

    The wheels turn before.
    """
    if turn_wheels(s) and s.next_look:  # 0: look at the next step
        look_for_garbage(s)
    if s.driving:
        another = s.leg_end
    elif not s.acted:
        another = s.step + s.second - s.idle % s.second
    else:
        another = FAR
    return max(min(s.due, s.end, s.wake, another), s.step + 1)


@compiled
def advance(s, end):
    """Simulates until step `end`, or until the first step in which something has changed.

    Garbage appears, humanoids turn and the robot looks around as scheduled. A contact, garbage that
    an action may use, and a look that shows something new end it.
    """
    turns, shaken = table(s.turns_at, s.turns, TURN), s.shaken
    spawn = next_spawn(s)
    if shaken:  # Chipmunk may still separate bodies
        end = s.step + 1
    while s.step < end:
        look = max(min(s.next_look, s.next_humanoid_look), s.step + 1)
        move(s, min(spawn, turns[s.turn].step, look, end))
        if s.crowded:
            return
        if shaken or touches(s):
            s.shaken = touches(s)
            touch(s)
        if s.step == spawn:
            spawn = drop_items(s)
        turn_humanoids(s)
        if s.step >= s.wake or s.changed:
            return
        is_due = s.step >= s.next_look or s.step >= s.next_humanoid_look
        if s.step < end and is_due and sense(s, False):
            return


@compiled
def touch(s):
    """Counts new collisions with humanoids; those that are touched step aside."""
    people = table(s.humanoids_at, s.humanoids, HUMANOID)
    contacts = table(s.contacts_at, 2 + len(people), np.int64)
    for _ in range(contacts[1]):
        log(s, COLLISION, 1.0)
    contacts[1] = 0
    for h in range(len(people)):
        one = people[h]
        if contacts[2 + h]:
            dx, dy = one.x - s.x, one.y - s.y
            gap = norm(dx, dy)
            faster = s.humanoid_speed / (gap if gap > 0 else 1.0)
            one.vx, one.vy = dx * faster, dy * faster
            steer(one.body, one.vx, one.vy)
        one.look = s.step
    s.leg_end = s.step  # so that the wheels are set again
    s.rolling = 1
    s.next_look = s.wake = s.next_humanoid_look = s.step


@compiled
def next_spawn(s):
    """The step in which the next item appears. Earlier items had no room and are left out."""
    if s.room <= 0:
        return FAR
    spawns = table(s.spawns_at, s.spawns, np.int64)
    while spawns[s.spawn] <= s.step:
        s.spawn += 1
    return spawns[s.spawn]


@compiled
def drop_items(s):
    """Adds the garbage of this step; returns the next step that has some."""
    items = table(s.items_at, s.items, ITEM)
    spawns = table(s.spawns_at, s.spawns, np.int64)
    while spawns[s.spawn] == s.step and s.room > 0:
        item = items[s.first_item + s.spawn]
        item.present = 1
        s.room -= 1
        s.spawn += 1
        gap = norm(item.x - s.x, item.y - s.y) - s.perception
        look = s.step
        if gap > 0:
            look += steps_to(gap, s.stride)
        else:
            s.wake = look  # an action may find it though the blackboard stays the same
        s.next_look = min(s.next_look, look)
    return spawns[s.spawn] if s.room > 0 else FAR


@compiled
def turn_humanoids(s):
    """Humanoids take new headings and find one more item; if one begins to ask, a look is due."""
    people, turns = table(s.humanoids_at, s.humanoids, HUMANOID), table(s.turns_at, s.turns, TURN)
    while turns[s.turn].step == s.step:
        turn = turns[s.turn]
        one = people[turn.humanoid]
        one.vx, one.vy = turn.vx, turn.vy
        steer(one.body, one.vx, one.vy)
        if one.carried < s.most_items:
            one.carried += 1
            if one.carried == s.ask_from:
                one.look = s.step
                s.next_humanoid_look = min(s.next_humanoid_look, s.step)
        s.turn += 1


@compiled
def account(s, steps):
    """Accounts for the last `steps` steps. A robot that neither drives nor acts is idle."""
    spend(s, steps)
    s.accounted_until = s.step
    if s.patrolling:
        s.patrol_steps += steps
    if s.acted:
        s.last_action = s.step
    if s.driving or s.acted:
        s.idle = 0
        return
    s.idle += steps
    if s.idle % s.second == 0:
        log(s, IDLE, s.idle / s.second)


@compiled
def deadline(s):
    """The step in which the episode ends unless an event postpones it."""
    low = s.battery < s.low_battery
    end = s.best_step + (s.stagnation_low_battery if low else s.stagnation)
    if s.negative_since >= 0:
        end = min(end, s.negative_since + s.negative)
    return min(end, s.length)


@compiled
def until_tick(s, status):
    """See `proceed`."""
    if s.phase == TICKED:
        after_tick(s, status)
    if s.phase == START:
        s.end = deadline(s)
    while True:
        if s.phase == TICKED:
            start = s.step
            to = horizon(s)
            advance(s, start + 1 if s.stepwise else to)
            if s.crowded:
                return CROWDED
            account(s, s.step - start)
            s.phase = ACCOUNTED
            if s.event_count:
                return COUNT
        if s.phase == ACCOUNTED:
            s.end = deadline(s)
            if s.battery <= 0 or s.step >= s.end:
                return ENDED
        s.phase = TICKED
        sense(s, s.stepwise)
        if s.changed or s.step >= s.due or s.step >= s.wake:
            before_tick(s)
            return TICK


@compiled
def behave(s, action, fresh):
    """The status of an action, by its number in the vocabulary."""
    if action == 0:
        return behaviour.move_to_garbage(s, fresh)
    if action == 1:
        return behaviour.pickup_garbage(s, fresh)
    if action == 2:
        return behaviour.seek_charger(s, fresh)
    if action == 3:
        return behaviour.execute_charge(s, fresh)
    if action == 4:
        return behaviour.move_to_humanoid(s, fresh)
    if action == 5:
        return behaviour.deliver_to_clearing_point(s, fresh)
    return behaviour.patrol_waypoint(s, fresh)


def _version() -> int:
    """A digest of the sources. numba only looks for changes of the file of a cached function."""
    digest = sha256()
    for source in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(source.read_bytes())
    return int.from_bytes(digest.digest()[:7], "big")


def _cached(function: Any) -> Any:
    """Compiles a function, and keeps its machine code if a folder takes it."""
    try:
        return njit(function, cache=True, error_model="numpy")
    except RuntimeError:  # neither the package nor the user's cache can be written
        return njit(function, error_model="numpy")


def _entries(version: int) -> tuple[Any, ...]:
    """The functions for Python. numba's key of a cached function has the value of `version`."""

    @_cached
    def act(record, action, fresh):
        assert version
        return behave(record[0], action, fresh)

    @_cached
    def proceed(record, status):
        assert version
        return until_tick(record[0], status)

    @_cached
    def straight(x, y, vx, vy, dt, steps):
        assert version
        return straight_on(x, y, vx, vy, dt, steps)

    return act, proceed, straight


act, proceed, straight = _entries(_version())


def _adds_as_chipmunk() -> bool:
    """True if coasting ends where Chipmunk's steps end, to the last bit.

    On some processors a compiler may round a product and a sum in one step.
    """
    space, steps, dt = pymunk.Space(), 100, 0.1
    for i in range(20):
        body = pymunk.Body(50.0, float("inf"))
        body.position, body.velocity = (100 / (i + 3), 7.7 * i), (10 / (i + 7), -1.3 / (i + 1))
        space.add(body)
    ends = [straight(*body.position, *body.velocity, dt, steps) for body in space.bodies]
    for _ in range(steps):
        space.step(dt)
    return ends == [body.position for body in space.bodies]


ADDS_AS_CHIPMUNK: Final = _adds_as_chipmunk()
