"""An episode in MiniGrid: a skill for each action, and one environment step per tick."""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any, Final

from grid_memory import Memory
from islandgp.domain import EventLog, Scene, png

if TYPE_CHECKING:
    from grid_world import Levels

TURN_LEFT, TURN_RIGHT, FORWARD, TAKE, PUT, TOGGLE, WAIT = range(7)  # MiniGrid's actions
STEPS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))  # by direction
TILE: Final = 20  # pixels per place in pictures

Skill = Generator[None, None, bool]


@cache
def levels() -> dict[str, str]:
    """The levels without moving obstacles: the newest Gymnasium id by short name."""
    import gymnasium
    import minigrid  # noqa: F401 -- it registers its levels

    names: dict[str, str] = {}
    named = [spec for spec in gymnasium.registry.values() if spec.name.startswith("MiniGrid-")]
    for spec in sorted(named, key=lambda spec: (spec.name, spec.version or 0)):
        short = spec.name.removeprefix("MiniGrid-")
        if not short.startswith("Dynamic-Obstacles"):
            names[short] = spec.id
    return names


@cache
def environment(level: str) -> Any:
    """Creates the environment of a level; all episodes of a process share it and reset it.

    Observations are switched off: `memory` computes the same view forty times as fast.
    """
    import gymnasium

    env: Any = gymnasium.make(levels()[level], disable_env_checker=True).unwrapped
    env.gen_obs = lambda: None
    return env


def mission(level: str, seed: int) -> str:
    """The mission of a level, in MiniGrid's terms."""
    env = environment(level)
    env.reset(seed=seed)
    return str(env.mission)


def beside(what: str) -> Callable[[GridRobot], Skill]:
    """The skill to go next to the nearest seen thing of this kind, and to face it."""

    def skill(self: GridRobot) -> Skill:
        places = self._places[what] & self.memory.seen
        if not places:
            return False
        if not (yield from self._go(self.memory.around(places))):
            return False
        ahead = self.memory.around(self.here) & places
        yield from self._face(ahead & -ahead)
        return True

    return skill


class GridRobot:
    """One episode: a method for each action; `step` executes the chosen environment action."""

    def __init__(self, world: Levels, seed: int, log: EventLog) -> None:
        self.log = log
        self.env = environment(world.levels[seed % len(world.levels)])
        self.env.reset(seed=seed)
        self.steps = min(self.env.max_steps, world.ticks)
        self.left, self.reward, self.wish = self.steps, 0.0, WAIT
        self._wanted = wanted(self.env.mission)
        self._opened: set[int] = set()  # ids of doors, and of things that were in hand
        self.memory = Memory(self.env.width, self.env.height)
        self._survey()
        self._look()

    # Knowledge

    def _survey(self) -> None:
        """Reads the positions of things, which only the robot changes."""
        places: dict[str, int] = dict.fromkeys(
            ("free", "clear", "key", "door", "locked", "goal", "object", "thing"), 0
        )
        grid, at = self.env.grid, self.memory.at
        for i, thing in enumerate(grid.grid):
            bit = at(i % grid.width, i // grid.width)
            if thing is None:
                places["free"] |= bit
                places["clear"] |= bit
                continue
            if thing.see_behind():
                places["clear"] |= bit
            if thing.can_overlap() and thing.type != "lava":
                places["free"] |= bit
            if thing.type in ("key", "goal"):
                places[thing.type] |= bit
            elif thing.type == "door" and not thing.is_open:
                places["locked" if thing.is_locked else "door"] |= bit
            if (thing.color, thing.type) == self._wanted:
                places["object"] |= bit
            elif thing.type in ("ball", "box"):
                places["thing"] |= bit
        self._places = places
        self.memory.fill(places["free"], places["clear"])

    def _look(self) -> None:
        """Updates the memory and the blackboard keys from the present view."""
        x, y = map(int, self.env.agent_pos)
        direction = int(self.env.agent_dir)
        new = self.memory.look(x, y, direction)
        if new:
            self.log("seen", new)
        memory, places = self.memory, self._places
        squares, carrying = memory.seen, self.env.carrying
        dx, dy = STEPS[direction]
        self.here, self.front = memory.at(x, y), memory.at(x + dx, y + dy)
        self._known = {
            "carryingKey": carrying is not None and carrying.type == "key",
            "keySeen": places["key"] & squares != 0,
            "doorSeen": places["door"] & squares != 0,
            "lockedDoorSeen": places["locked"] & squares != 0,
            "objectSeen": places["object"] & squares != 0,
            "thingSeen": places["thing"] & squares != 0,
            "goalSeen": places["goal"] & squares != 0,
            "moreToSee": memory.frontier != 0,
            "facingDoor": (places["door"] | places["locked"]) & self.front != 0,
            "stepsLeft": 100.0 * self.left / self.steps,
        }

    def sense(self) -> Mapping[str, float]:
        """See `Simulation`."""
        return self._known

    # Skills

    GoToKey = beside("key")
    GoToDoor = beside("door")
    GoToLockedDoor = beside("locked")
    GoToObject = beside("object")
    GoToThing = beside("thing")

    def GoToGoal(self) -> Skill:
        return (yield from self._go(self._places["goal"] & self.memory.seen))

    def Explore(self) -> Skill:
        before = self.memory.seen
        path = self.memory.way(self.here, self.memory.frontier)
        if path is None:
            return False
        for place in path:
            yield from self._step_onto(place)
            if self.memory.seen != before:
                return True
        unseen = self.memory.around(self.here) & self.memory.inside & ~self.memory.seen
        yield from self._face(unseen & -unseen)
        return True

    def PickUp(self) -> Skill:
        thing = self._ahead()
        if self.env.carrying is not None or thing is None or not thing.can_pickup():
            return False
        yield from self._do(TAKE)
        return self.env.carrying is not None

    def Toggle(self) -> Skill:
        door = self._ahead()
        if door is None or door.type != "door" or door.is_open:
            return False
        yield from self._do(TOGGLE)
        return bool(door.is_open)

    def Drop(self) -> Skill:
        if self.env.carrying is None:
            return False
        for _ in STEPS:
            yield from self._do(TURN_RIGHT)
            if self._ahead() is None:
                yield from self._do(PUT)
                return self.env.carrying is None
        return False

    def _go(self, ends: int) -> Skill:
        path = self.memory.way(self.here, ends)
        if path is None:
            return False
        for place in path:
            yield from self._step_onto(place)
            if self.here != place:
                return False
        return True

    def _step_onto(self, place: int) -> Generator[None, None, None]:
        yield from self._face(place)
        yield from self._do(FORWARD)

    def _face(self, place: int) -> Generator[None, None, None]:
        """Turns to a neighbouring place by the shorter way; does nothing for any other place."""
        stride = self.memory.stride
        around = (self.here << 1, self.here << stride, self.here >> 1, self.here >> stride)
        if place not in around:  # another skill, in parallel, has led it away
            return
        turns = (around.index(place) - self.env.agent_dir) % 4
        for _ in range(1 if turns == 3 else turns):
            yield from self._do(TURN_LEFT if turns == 3 else TURN_RIGHT)

    def _do(self, action: int) -> Generator[None, None, None]:
        self.wish = action
        yield

    def _ahead(self) -> Any:
        """The thing in front of the robot, or None."""
        x, y = self.env.agent_pos
        dx, dy = STEPS[self.env.agent_dir]
        return self.env.grid.get(x + dx, y + dy)

    # Time

    def step(self) -> str:
        """See `Simulation`: one step of the environment."""
        action, self.wish = self.wish, WAIT
        handled = action in (TAKE, PUT, TOGGLE)
        thing = (self.env.carrying if action == PUT else self._ahead()) if handled else None
        locked = thing is not None and thing.type == "door" and thing.is_locked
        _, reward, terminated, truncated, _ = self.env.step(action)
        self.left -= 1
        self.log("step")
        if handled:
            self._handled(action, thing, locked)
        self._look()
        if reward > 0:
            self.reward = float(reward)
            self.log("solved", self.reward)
            return "solved"
        if terminated:
            return "failed"
        return "time" if truncated or not self.left else ""

    def _handled(self, action: int, thing: Any, locked: bool) -> None:
        """Logs the first use of each thing, and updates the positions of things."""
        self._survey()
        if action == PUT:
            if self.env.carrying is None:
                self.log("dropped")
        elif thing is not None and id(thing) not in self._opened:
            if action == TAKE and self.env.carrying is thing:
                self._opened.add(id(thing))
                if thing.type == "key":
                    self.log("key")
            elif action == TOGGLE and thing.type == "door" and thing.is_open:
                self._opened.add(id(thing))
                self.log("opened")
                if locked:
                    self.log("unlocked")

    def measures(self) -> Mapping[str, float]:
        """See `Simulation`."""
        share = self.memory.seen.bit_count() / self.memory.inside.bit_count()
        return {"reward": self.reward, "explored": 100.0 * share}

    def scene(self) -> Scene:
        """See `Simulation`: MiniGrid's own picture, with the field of view."""
        bounds = (0.0, 0.0, float(self.env.width), float(self.env.height))
        return Scene(bounds, frame=lambda: png(self.env.get_frame(tile_size=TILE)))


def wanted(mission: str) -> tuple[str, str] | None:
    """(colour, type) of the object that a mission asks for, if it asks for one."""
    match = re.fullmatch(r"(?:pick up|go to) (?:the|a) (\w+) (ball|box|key|door)", mission)
    return (match[1], match[2]) if match else None
