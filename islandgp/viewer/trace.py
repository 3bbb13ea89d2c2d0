"""The trace of a tree's episode: counts at each node, and the actions in order."""

from __future__ import annotations

import heapq
import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import ceil, inf
from typing import TYPE_CHECKING, Final

from islandgp.bt.core.node import Node, walk
from islandgp.bt.core.printer import condition_text
from islandgp.bt.export.render import to_rich
from islandgp.viewer.recording import FAILED, IDLE, RUNS, STOPPED, SUCCEEDED, Credit, Recording

if TYPE_CHECKING:
    from rich.text import Text

ELLIPSIS: Final = "\N{HORIZONTAL ELLIPSIS}"
MAX_LINES: Final = 5_000  # of a timeline
MAX_GUARDS: Final = 8  # on such a line
_SPAN: Final = re.compile(
    b"%(runs)c[%(runs)c%(idle)c]*+[^%(runs)c%(idle)c]?|[^%(runs)c%(idle)c]"
    % {b"runs": RUNS, b"idle": IDLE}
)
"""The codes of a node from its start to the tick in which it ended, if it did."""
_WORDS: Final = {RUNS: "runs", SUCCEEDED: "succeeded", FAILED: "failed", STOPPED: "was aborted"}
SIGNS: Final = {
    SUCCEEDED: ("\N{CHECK MARK}", "green"),
    FAILED: ("\N{BALLOT X}", "red"),
    STOPPED: ("\N{CIRCLED DIVISION SLASH}", "magenta"),
    RUNS: ("\N{BLACK RIGHT-POINTING POINTER}", "bold yellow"),
}
"""Sign and rich style of a node's last status."""


@dataclass(frozen=True, slots=True)
class ActionSpan:
    """An action from its start to its end, or to the end of the episode."""

    start: int  # tick
    end: int  # tick of the last call
    place: int  # of the action in document order
    action: str
    result: int  # SUCCEEDED, FAILED, STOPPED, or RUNS at the end of the episode
    points: float  # that the action earned in the span
    times: int = 1  # number of merged spans


def action_spans(recording: Recording, begin: int = 0) -> Iterator[ActionSpan]:
    """The spans of actions that start at a tick or later, in order of their start.

    They are computed lazily, as large trees can have millions of them.
    """
    earned: dict[str, list[Credit]] = {}
    for credit in sorted(recording.credits, key=lambda credit: credit.tick):
        earned.setdefault(credit.action, []).append(credit)
    names = [(p, n.action) for p, n in enumerate(walk(recording.tree)) if n.action]
    of_actions = [
        _of_action(recording.statuses[place], place, name, earned.get(name, []), begin)
        for place, name in names
    ]
    return heapq.merge(*of_actions, key=lambda span: (span.start, span.place))


def merged(spans: Iterable[ActionSpan]) -> Iterator[ActionSpan]:
    """Merges repeated spans of zero duration with the same action and result."""
    last: ActionSpan | None = None
    for span in spans:
        same = last is not None and (last.place, last.result) == (span.place, span.result)
        if last is not None and same and span.start == span.end and last.end >= span.start - 1:
            points = last.points + span.points
            last = replace(last, end=span.end, points=points, times=last.times + 1)
            continue
        if last is not None:
            yield last
        last = span
    if last is not None:
        yield last


def _of_action(
    codes: bytes, place: int, action: str, credits: Sequence[Credit], begin: int
) -> Iterator[ActionSpan]:
    """The spans of one node that start at a tick or later; `credits` are its action's, by tick."""
    under_way = 0 < begin <= len(codes) and codes[begin - 1] == RUNS
    for match in islice(_SPAN.finditer(codes, begin), int(under_way), None):
        start, end, result = match.start(), match.end() - 1, match[0][-1]
        if result in (RUNS, IDLE):
            end, result = len(codes) - 1, RUNS
        first = bisect_left(credits, start, key=lambda credit: credit.tick)
        behind = bisect_right(credits, end, key=lambda credit: credit.tick)
        points = sum(credit.points for credit in credits[first:behind])
        yield ActionSpan(start, end, place, action, result, points)


def drawn(recording: Recording) -> Text:
    """The tree, with the numbers of ticks, successes, failures and aborts of each node."""
    from rich.text import Text

    notes = []
    for counts in recording.counts:
        if not sum(counts):
            notes.append(Text("never reached", "bold red"))
            continue
        ticks = counts[FAILED] + counts[SUCCEEDED] + counts[RUNS]
        note = Text(f"{100 * ticks / recording.ticks:5.1f} %  ")
        for code in (SUCCEEDED, FAILED, STOPPED):
            sign, style = SIGNS[code]
            note.append(f"{sign}{counts[code]:<5}", style if counts[code] else "dim")
        notes.append(note)
    return to_rich(recording.tree, notes)


def timeline(recording: Recording, begin: float = 0.0, end: float = inf) -> Iterator[Text]:
    """A heading and one line per action that began between two times, in s.

    After MAX_LINES a last line has the number of those left out.
    """
    from rich.text import Text

    step, digits = recording.step_s, recording.digits
    guards = _guards(recording.tree)
    actions = [node.action for node in walk(recording.tree) if node.action]
    wide = max([6, *map(len, actions)])
    yield Text(f"{'start':>9}  {'lasted':>8}  {'action':<{wide}}  {'result':<20}{'points':>9}")
    first = ceil(min(begin / step - 1e-9, recording.ticks))
    for number, span in enumerate(merged(action_spans(recording, first))):
        if span.start * step > end:
            return
        if number == MAX_LINES:
            yield Text(
                f"More than {MAX_LINES:,} lines: the rest is left out; --from and --to choose a"
                " part.",
                "bold",
            )
            return
        lasted = (span.end - span.start + 1) * step
        line = Text(f"{span.start * step:7.1f} s  {lasted:6.1f} s  {span.action:<{wide}}  ")
        times = f" {span.times} times" if span.times > 1 else ""
        line.append(f"{_WORDS[span.result] + times:<20}", SIGNS[span.result][1])
        line.append(f"{span.points:+9,.{digits}f}" if span.points else " " * 9)
        line.append(f"  {guards[span.place]}".rstrip(), "dim")
        yield line


def _guards(tree: Node) -> list[str]:
    """The conditions above each node, at most the innermost MAX_GUARDS."""
    guards: list[str] = []

    def visit(node: Node, above: tuple[str, ...], text: str) -> None:
        guards.append(text)
        if node.guard:
            above = (*above, condition_text(node.guard.condition))
            innermost = above if len(above) <= MAX_GUARDS else (ELLIPSIS, *above[-MAX_GUARDS:])
            text = " & ".join(innermost)  # shared by all descendants
        for child in node.children:
            visit(child, above, text)

    visit(tree, (), "")
    return guards


def trace(recording: Recording, begin: float, end: float) -> Iterator[Text | str]:
    """The outcome, the tree, the timeline between two times, in s, and the points."""
    outcome = recording.outcome
    yield (
        f"World {recording.seed}, stage {recording.stage + 1}:"
        f" {outcome.fitness:,.{recording.digits}f} points in {outcome.seconds:,g} s, ended by"
        f" {', '.join(outcome.endings)}\n"
    )
    yield drawn(recording)
    yield ""
    yield from timeline(recording, begin, end)
    yield ""
    yield from components(recording)


def components(recording: Recording) -> Iterator[str]:
    """A line for each component that earned points, and one for the fitness."""
    outcome = recording.outcome
    points = {name: value for name, value in outcome.components.items() if value}
    points["fitness"] = outcome.fitness
    wide = max(map(len, points)) + 2
    return (f"{name:<{wide}}{value:+12,.{recording.digits}f}" for name, value in points.items())
