"""An episode in the terminal: the world as letters, the tree, the blackboard, and the points."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Final

from islandgp.bt.export.render import to_rich
from islandgp.viewer.recording import Recording, SceneTrack
from islandgp.viewer.trace import SIGNS, point_lines

if TYPE_CHECKING:
    from rich.console import Group, RenderableType
    from rich.text import Text

COLUMNS, ROWS = 60, 30  # characters of a square world; each is twice as high as wide
FRAMES: Final = 8  # per second


def watch(recording: Recording, *, speed: float, pause: Callable[[float], None]) -> None:
    """Shows an episode at `speed` times real time; `pause(seconds)` waits between frames.

    If the output is not a terminal, about 40 lines of text are printed instead.
    """
    if not sys.stdout.isatty():
        least = 10.0 if recording.step_s < 1 else recording.step_s  # s
        for line in lines(recording, every=max(least, recording.outcome.seconds / 42)):
            print(line)
        return
    from rich.live import Live

    each = max(1, round(speed / FRAMES / recording.step_s))
    waits = max(1 / FRAMES, each * recording.step_s / speed)  # s; longer where a tick is
    with Live(frame(recording, 0), auto_refresh=False) as live:
        for tick in [*range(0, recording.ticks, each), recording.ticks - 1]:
            live.update(frame(recording, tick), refresh=True)
            pause(min(waits, 1.0))


def lines(recording: Recording, *, every: float) -> Iterator[str]:
    """The episode as lines of text, one per `every` seconds, and one for its end."""
    apart = max(1, round(every / recording.step_s))
    keys = recording.schema.vocabulary.keys
    robot = recording.scenes.movers[-1] if recording.scenes and recording.scenes.movers else None
    for tick in [*range(0, recording.ticks - 1, apart), recording.ticks - 1]:
        at = "" if robot is None else f"  at ({robot[tick].x:5.1f}, {robot[tick].y:5.1f})"
        board = "  ".join(
            f"{name}={value:g}" for name, value in zip(keys, recording.boards[tick], strict=True)
        )
        points = f"{points_at(recording, tick):9,.{recording.digits}f} points"
        yield f"{tick * recording.step_s:6.1f} s{at}  {points}  {board}"


def points_at(recording: Recording, tick: int) -> float:
    """Fitness up to and including a tick."""
    return sum(credit.points for credit in recording.credits if credit.tick <= tick)


def frame(recording: Recording, tick: int) -> Group:
    """The display of a tick."""
    from rich.columns import Columns
    from rich.console import Group
    from rich.panel import Panel
    from rich.text import Text

    notes = [Text(*SIGNS.get(line[tick], (" ", ""))) for line in recording.statuses]
    seconds = f"{tick * recording.step_s:.1f} of {recording.outcome.seconds:.0f} s"
    title = f"{seconds}, {points_at(recording, tick):,.{recording.digits}f} points"
    side = Group(
        Panel(to_rich(recording.tree, notes), title="tree"),
        Panel(_board(recording, tick), title="blackboard"),
        Panel(_components(recording, tick), title="fitness"),
    )
    panels: list[RenderableType] = [side]
    if recording.scenes is not None and recording.scenes.styles():
        panels.insert(0, Panel(_map(recording, recording.scenes, tick), title=title))
        return Group(Columns(panels))
    return Group(Text(title, "bold"), side)


def _map(recording: Recording, track: SceneTrack, tick: int) -> Text:
    """The world as letters; later things are drawn over earlier ones."""
    from rich.text import Text

    left, low, right, top = track.bounds
    width, height = right - left or 1.0, top - low or 1.0
    columns = max(1, round(COLUMNS * min(1.0, width / height)))
    rows = max(1, round(ROWS * min(1.0, height / width)))
    cells = [[(" ", "")] * columns for _ in range(rows)]

    def put(name: str, x: float, y: float, style: str = "") -> None:
        look = recording.schema.styles[name]
        if look.sign.strip():
            column = min(columns - 1, max(0, int((x - left) / width * columns)))
            row = min(rows - 1, max(0, int((top - y) / height * rows)))
            cells[row][column] = (look.sign[0], f"{look.colour}{style}")

    for shape in (*track.fixed, *(s.shape for s in track.items if s.begin <= tick < s.end)):
        put(shape.style, shape.x, shape.y)
    for mover in track.movers:
        style = " bold reverse" if mover is track.movers[-1] else " bold"
        put(mover[tick].style, mover[tick].x, mover[tick].y, style)
    return Text("\n").join(Text.assemble(*((sign, style) for sign, style in row)) for row in cells)


def _board(recording: Recording, tick: int) -> Text:
    from rich.text import Text

    keys = recording.schema.vocabulary.keys
    wide = max(map(len, keys), default=0) + 2
    rows = []
    for (name, key), value in zip(keys.items(), recording.boards[tick], strict=True):
        text = key.text_of(value) if key.flag or key.words else f"{value:.1f}"
        rows.append(f"{name:<{wide}}{text:>7}")
    return Text("\n".join(rows))


def _components(recording: Recording, tick: int) -> Text:
    from rich.text import Text

    sums = dict.fromkeys(recording.schema.components, 0.0)
    for credit in recording.credits:
        if credit.tick <= tick:
            sums[credit.component] += credit.points
    return Text("\n".join(point_lines(sums, recording.digits)))
