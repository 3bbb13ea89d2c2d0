"""Encodes a recording as compact JSON values for the page: rounded, and changes only."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, pairwise
from math import inf, isfinite
from typing import Any, Final

from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.node import SUCCESS, thresholds, walk
from islandgp.bt.core.vocabulary import Key
from islandgp.bt.export.render import label, lay_out
from islandgp.domain import Shape
from islandgp.viewer.recording import Recording, digits

LETTERS: Final = ".fsrx"  # a letter per code: idle, failed, succeeded, runs, stopped
GRID: Final = 3000  # grid cells along the picture's longer side, for positions
MAX_FRAME_BYTES: Final = 4_000_000
"""Most bytes of PNG in a page. Of more frames, evenly spaced ones are kept."""


def encode(recording: Recording, *, title: str) -> dict[str, Any]:
    """Encodes a recording for the page's script; `page/data.js` decodes it."""
    schema = recording.schema
    components = [*schema.components]
    return {
        "title": title,
        "domain": schema.vocabulary.domain,
        "seed": recording.seed,
        "stage": recording.stage + 1,
        "ticks": recording.ticks,
        "step": recording.step_s,
        "seconds": recording.outcome.seconds,
        "ending": ", ".join(recording.outcome.endings),
        "fitness": recording.outcome.fitness,
        "digits": recording.digits,
        "scene": _Scene(recording).plain() if recording.scenes else None,
        "board": _board(recording),
        "components": [{"name": c, "meaning": schema.components[c]} for c in components],
        "paints": _paints(recording),
        "credits": [
            [c.tick, components.index(c.component), round(c.points, recording.digits + 2)]
            for c in recording.credits
            if c.points
        ],
        "nodes": [
            {"kind": box.node.kind, "label": label(box.node), "parent": box.parent}
            for box in lay_out(recording.tree)[0]
        ],
        "statuses": [runs(line) for line in recording.statuses],
    }


def runs(codes: bytes) -> str:
    """Codes as letters with run lengths: `r3fr` is running three times, failed, running."""
    encoded = []
    for code, group in groupby(codes):
        count = sum(1 for _ in group)
        encoded.append(LETTERS[code] + (str(count) if count > 1 else ""))
    return "".join(encoded)


def path(xs: Sequence[float], ys: Sequence[float]) -> list[int]:
    """A path as [tick, x, y, ticks since then, dx, dy, ...], linear in between.

    The error at each tick is at most 1 in x and in y.
    """
    at_x, at_y, start = round(xs[0]), round(ys[0]), 0
    encoded = [0, at_x, at_y]
    low_x = low_y = -inf  # of the slopes that stay near all places since `start`
    high_x = high_y = inf
    for tick in range(1, len(xs) + 1):
        if tick < len(xs):
            past = tick - start
            x, y = xs[tick] - at_x, ys[tick] - at_y
            to_x, to_y = (round(xs[tick]) - at_x) / past, (round(ys[tick]) - at_y) / past
            if low_x <= to_x <= high_x and low_y <= to_y <= high_y:
                low_x, high_x = max(low_x, (x - 1) / past), min(high_x, (x + 1) / past)
                low_y, high_y = max(low_y, (y - 1) / past), min(high_y, (y + 1) / past)
                continue
        if (end := tick - 1) > start:
            x, y = round(xs[end]), round(ys[end])
            encoded += [end - start, x - at_x, y - at_y]
            at_x, at_y, start = x, y, end
        if tick < len(xs):
            x, y = xs[tick] - at_x, ys[tick] - at_y
            low_x, high_x, low_y, high_y = x - 1, x + 1, y - 1, y + 1
    return encoded


def changes(values: Iterable[Any]) -> list[Any]:
    """The changes of a value as [tick, value, ticks since then, value, ...]."""
    encoded: list[Any] = []
    last, before = 0, object()
    for tick, value in enumerate(values):
        if value != before:
            encoded += [tick - last, value]
            last, before = tick, value
    return encoded


def spans(items: Sequence[Sequence[Shape]]) -> Iterator[tuple[int, Shape, int]]:
    """Each item with its first tick and the first tick without it, from the items of each tick.

    Equal items are numbered: of two, one can go.
    """
    present: dict[tuple[Shape, int], int] = {}  # an item and its number, with its first tick
    for tick, (before, now) in enumerate(pairwise([(), *items, ()])):
        if now != before:
            numbered = [(item, now[:place].count(item)) for place, item in enumerate(now)]
            for item, number in present.keys() - {*numbered}:
                yield present.pop((item, number)), item, tick
            present |= {key: tick for key in numbered if key not in present}


def _board(recording: Recording) -> list[dict[str, Any]]:
    return [
        {
            "key": name,
            "flag": key.flag,
            "meaning": key.meaning,
            "low": key.low,
            "most": key.most,
            "words": key.words,
            "marks": [] if key.flag else thresholds(recording.tree, name),
            "changes": changes(_rounded([board[place] for board in recording.boards], key)),
        }
        for place, (name, key) in enumerate(recording.schema.vocabulary.keys.items())
    ]


def _rounded(values: Iterable[float], key: Key) -> Iterator[float | None]:
    """Rounded to a tenth, or finer for thresholds; None for a number that is not finite."""
    decimals = max(1, digits([key.step]) - 1)
    return (round(value, decimals) if isfinite(value) else None for value in values)


def _paints(recording: Recording) -> dict[str, int]:
    """The component of which each action earned most, for its colour on the timeline; -1: none.

    An action that earned nothing has the component of the next action in the same sequence.
    """
    components = [*recording.schema.components]
    earned: dict[str, dict[int, float]] = {}
    for credit in recording.credits:
        of_action = earned.setdefault(credit.action, {})
        place = components.index(credit.component)
        of_action[place] = of_action.get(place, 0.0) + abs(credit.points)
    paints: dict[str, int] = {}
    for node in walk(recording.tree):
        if node.action:
            points = earned.get(node.action) or {-1: 0.0}
            paints[node.action] = max(points, key=lambda place: points[place])
    for node in walk(recording.tree):
        if kind_of(node).advance_status == SUCCESS:
            names = pairwise(child.action for child in node.children)
            for name, behind in reversed([*names]):
                if paints.get(name) == -1:
                    paints[name] = paints.get(behind, -1)
    return paints


class _Scene:
    """Encodes scenes as plain values; positions are on a grid from the lower left corner."""

    def __init__(self, recording: Recording) -> None:
        self.scenes, self.frames = recording.scenes, recording.frames
        lefts, lows, rights, tops = zip(*{scene.bounds for scene in self.scenes}, strict=True)
        self.x, self.y = min(lefts), min(lows)
        self.width, self.height = max(rights) - self.x, max(tops) - self.y
        self.unit = max(self.width, self.height) / GRID or 1.0
        styles = {shape.style for s in self.scenes for shape in (*s.fixed, *s.items, *s.movers)}
        self.shapes = {n: f for n, f in recording.schema.styles.items() if n in styles}
        self.styles = [*self.shapes]
        self.looks: dict[tuple[int, float, str], int] = {}  # with the index of each

    def plain(self) -> dict[str, Any]:
        """The scene data for the page's script."""
        encoded = {
            "width": round(self.width / self.unit, 3),
            "height": round(self.height / self.unit, 3),
            "styles": [[f.meaning, f.shape, f.colour] for f in self.shapes.values()],
            "fixed": [self._shape(shape) for shape in self.scenes[0].fixed],
            "items": [
                [*self._shape(shape), begin, end]
                for begin, shape, end in sorted(spans([scene.items for scene in self.scenes]))
            ],
            "movers": self._movers([*zip(*(s.movers for s in self.scenes), strict=True)]),
            **self._frames(self.frames),
        }
        return {**encoded, "looks": [*self.looks]}

    def _look(self, style: str, size: float, text: str) -> int:
        plain = (self.styles.index(style), round(size / self.unit, 1), text)
        return self.looks.setdefault(plain, len(self.looks))

    def _shape(self, shape: Shape) -> list[int]:
        style, x, y, size, text = shape
        look = self._look(style, size, text)
        return [look, round((x - self.x) / self.unit), round((y - self.y) / self.unit)]

    def _movers(self, movers: Sequence[Sequence[Shape]]) -> list[dict[str, Any]]:
        paths = [[(shape.x, shape.y) for shape in mover] for mover in movers]
        encoded = []
        for place, (path_points, mover) in enumerate(zip(paths, movers, strict=True)):
            first = paths.index(path_points)  # movers with equal positions share them
            looks = changes((style, size, text) for style, _, _, size, text in mover)
            looks[1::2] = [self._look(*look) for look in looks[1::2]]
            way = first if first < place else self._path(path_points)
            encoded.append({"way": way, "looks": looks})
        return encoded

    def _path(self, places: Sequence[tuple[float, float]]) -> list[int]:
        return path(
            [(x - self.x) / self.unit for x, _ in places],
            [(y - self.y) / self.unit for _, y in places],
        )

    @staticmethod
    def _frames(frames: Sequence[tuple[int, bytes]]) -> dict[str, Any]:
        """The distinct pictures, and the index of the picture from each tick on."""
        every = max(1, -(-sum(map(len, {frame for _, frame in frames})) // MAX_FRAME_BYTES))
        places: dict[bytes, int] = {}
        encoded, last = [], 0
        for tick, frame in frames[::every]:
            encoded += [tick - last, places.setdefault(frame, len(places))]
            last = tick
        return {"frames": [b64encode(frame).decode() for frame in places], "shown": encoded}
