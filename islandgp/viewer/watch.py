"""An episode in the terminal: the island in letters, the tree, the blackboard, the points."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

from islandgp.bt.node import KEYS
from islandgp.bt.render.terminal import to_rich
from islandgp.scoring.rewards import Component
from islandgp.viewer.recording import FAILED, RUNS, STOPPED, SUCCEEDED, Recording

if TYPE_CHECKING:
    from rich.console import Group
    from rich.text import Text

COLUMNS, ROWS = 60, 30  # letters of the island: each 5 m wide and 10 m high on 300 m
FRAMES: Final = 8  # a second on the viewer's clock

_SIGNS: Final = {
    RUNS: ("\N{BLACK RIGHT-POINTING POINTER}", "bold yellow"),
    SUCCEEDED: ("\N{CHECK MARK}", "green"),
    FAILED: ("\N{BALLOT X}", "red"),
    STOPPED: ("\N{CIRCLED DIVISION SLASH}", "magenta"),
}


def watch(recording: Recording, *, speed: float, pause: Callable[[float], None]) -> None:
    """Shows the episode; `speed` times as fast as it is, `pause(seconds)` waits between frames.

    Where the output is no terminal, a line every ten seconds of the episode takes its place.
    """
    if not sys.stdout.isatty():
        for line in lines(recording, every=10.0):
            print(line)
        return
    from rich.live import Live

    each = max(1, round(speed / FRAMES / recording.world.episode.step))
    with Live(frame(recording, 0), auto_refresh=False) as live:
        for tick in [*range(0, recording.ticks, each), recording.ticks - 1]:
            live.update(frame(recording, tick), refresh=True)
            pause(1 / FRAMES)


def lines(recording: Recording, *, every: float) -> Iterator[str]:
    """The episode as lines of text, one every so many seconds and one for the end."""
    step = recording.world.episode.step
    apart = max(1, round(every / step))
    for tick in [*range(0, recording.ticks - 1, apart), recording.ticks - 1]:
        at = recording.robot[tick]
        board = "  ".join(
            f"{name}={value:g}" for name, value in zip(KEYS, recording.boards[tick], strict=True)
        )
        yield (
            f"{tick * step:6.1f} s  at ({at.real:5.1f}, {at.imag:5.1f})"
            f"  {points_at(recording, tick):9,.0f} points  {board}"
        )


def points_at(recording: Recording, tick: int) -> float:
    """Fitness up to and including a tick."""
    return sum(credit.points for credit in recording.credits if credit.tick <= tick)


def frame(recording: Recording, tick: int) -> Group:
    """What is shown at a tick."""
    from rich.columns import Columns
    from rich.console import Group
    from rich.panel import Panel
    from rich.text import Text

    notes = [Text(*_SIGNS.get(line[tick], (" ", ""))) for line in recording.statuses]
    seconds = tick * recording.world.episode.step
    title = f"{seconds:.1f} of {recording.seconds:.0f} s, {points_at(recording, tick):,.0f} points"
    side = Group(
        Panel(to_rich(recording.tree, notes), title="tree"),
        Panel(_board(recording, tick), title="blackboard"),
        Panel(_components(recording, tick), title="fitness"),
    )
    return Group(Columns([Panel(_map(recording, tick), title=title), side]))


def _map(recording: Recording, tick: int) -> Text:
    from rich.text import Text

    cells = [[(" ", "")] * COLUMNS for _ in range(ROWS)]
    world = recording.world

    def put(at: complex, sign: str, style: str) -> None:
        column = min(COLUMNS - 1, max(0, int(at.real / world.side * COLUMNS)))
        row = min(ROWS - 1, max(0, int((1 - at.imag / world.side) * ROWS)))
        cells[row][column] = (sign, style)

    for x, y, _ in recording.rocks:
        put(complex(x, y), "o", "bright_black")
    for points, sign, style in (
        (world.waypoints, "+", "green"),
        (world.chargers, "C", "bold yellow"),
        (world.clearing_points, "D", "bold blue"),
    ):
        for x, y in points:
            put(complex(x, y), sign, style)
    for x, y, begin, end in recording.garbage:
        if begin <= tick < end:
            put(complex(x, y), "\N{MIDDLE DOT}", "red")
    for at, items in zip(recording.humanoids[tick], recording.carried[tick], strict=True):
        asks = items >= world.humanoids.ask_from
        put(complex(at), "H" if asks else "h", "bold magenta" if asks else "magenta")
    put(recording.robot[tick], "R", "bold reverse")
    text = Text()
    for number, row in enumerate(cells):
        text.append("\n" if number else "")
        for sign, style in row:
            text.append(sign, style)
    return text


def _board(recording: Recording, tick: int) -> Text:
    from rich.text import Text

    text = Text()
    for place, (name, key) in enumerate(KEYS.items()):
        value = recording.boards[tick][place]
        told = ("yes" if value else "no") if key.flag else f"{value:.1f}"
        text.append(f"{'' if place == 0 else chr(10)}{name:<26}{told:>7}")
    return text


def _components(recording: Recording, tick: int) -> Text:
    from rich.text import Text

    sums = dict.fromkeys(Component, 0.0)
    for credit in recording.credits:
        if credit.tick <= tick:
            sums[credit.component] += credit.points
    return Text("\n".join(f"{c.name.lower():<14}{sums[c]:>+10,.0f}" for c in Component))
