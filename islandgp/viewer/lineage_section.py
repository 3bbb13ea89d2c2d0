"""The lineage of the best robot on a run's page: one list item per ancestor."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import Final

from islandgp.text import in_points
from islandgp.viewer.ancestry import Lineage, LineageStep, lineage
from islandgp.viewer.run_view import RunView

STEPS: Final = (6, 34)  # numbers of the first and last steps shown of a long lineage
NOTE: Final = 300  # most characters of a supervisor's reason


def lineage_section(view: RunView) -> Iterator[str]:
    """The HTML of the lineage, one list item per tree."""
    if view.champion is None:
        yield "<p>None yet.</p>"
        return
    chain = lineage(view.folder, view.champion["id"])
    yield f"<p>{escape(_chain(chain))}</p>"
    first, last = STEPS
    steps = chain.steps
    yield '<ol class="lineage">'
    if len(steps) > first + last:
        yield from (_item(view, step) for step in steps[:first])
        hidden = len(steps) - first - last
        yield f'<li class="gap">{hidden:,} trees between these are not shown.</li>'
        steps = steps[-last:]
    yield from (_item(view, step) for step in steps)
    yield "</ol>"


def _chain(lineage: Lineage) -> str:
    """A paragraph on the lineage as a whole."""
    steps = lineage.steps
    if not steps:
        return "The records of its generation are missing."
    if len(steps) == 1:
        text = f"It was created in one step: {_origin(steps[0])}."
    else:
        text = (
            f"{len(steps):,} trees in {steps[-1].generation + 1:,} generations, each derived"
            " from the one before. Points of two of them are from different worlds, unless they"
            " are of one generation, so their difference is partly luck."
        )
    if not lineage.is_complete:
        text += " The ancestors of the first one are not in the records."
    return text


def _item(view: RunView, step: LineageStep) -> str:
    period = ""
    if step.until > step.generation:
        last = "" if view.champion is None else view.champion["id"]
        name = f" as {last}" if last.startswith(f"{step.until}.") else ""
        period = f", kept to generation {step.until}{name} (mean of {step.evaluated} evaluations)"
    return (
        f"<li><b>{escape(step.id)}</b> {escape(_origin(step))}"
        f'<p class="soft">{in_points(step.fitness)} points, {step.nodes} nodes{period}</p>'
        f"{_guidance(step)}{_changes(step)}</li>"
    )


def _origin(step: LineageStep) -> str:
    """The origin of a tree, in words."""
    names = step.parents
    first = names[0] if names else "a tree that is not in the records"
    origins = {
        "random": "drawn at random",
        "crossover": f"a child of {' and '.join(dict.fromkeys(names))}",
        "copy": f"a child of {first}",
        "elite": f"the elite {first}",
        "behavioural_elite": f"the elite {first} of its behaviour",
        "resurrected": f"{first}, brought back",
        "injected": "given at the start",
    }
    text = origins.get(step.origin, step.origin)
    if step.origin == "injected" and step.generation:
        text = "injected by the supervisor"
        if step.guidance is not None:
            target = step.guidance.get("target")
            text = f"injected by {step.guidance['source']}" + (f" for {target}" if target else "")
    mutation = step.mutation
    if step.origin == "edited":
        kind, _, mutation = mutation.removeprefix("edit:").partition("+")
        text = f"{first}, edited by the supervisor ({kind})"
    return f"{text}, then mutation {mutation}" if mutation else text


def _guidance(step: LineageStep) -> str:
    if step.guidance is None:
        return ""
    reason = str(step.guidance.get("rationale") or step.guidance.get("reasoning") or "")
    reason = reason if len(reason) <= NOTE else f"{reason[:NOTE]} ..."
    return f'<p class="soft">{escape(reason)}</p>' if reason else ""


def _changes(step: LineageStep) -> str:
    if step.left_out < 0:
        return '<p class="soft">The trees are too large to compare here.</p>'
    if not step.changes:
        return f"<details><summary>The tree</summary><pre>{escape(step.tree)}</pre></details>"
    marks = {"-": "deleted", "+": "inserted", "~": "changed"}
    lines = [
        f'<span class="{marks[c.mark]}">{c.mark} {"  " * c.level}{escape(c.text)}</span>'
        for c in step.changes
    ]
    if step.left_out:
        lines.append(f"... and {step.left_out} more")
    counts = {word: sum(c.mark == mark for c in step.changes) for mark, word in marks.items()}
    summary = "What changed: " + ", ".join(f"{n} {word}" for word, n in counts.items() if n)
    body = "\n".join(lines)
    return f'<details><summary>{summary}</summary><pre class="diff">{body}</pre></details>'
