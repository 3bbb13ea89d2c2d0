"""A run's page, `run.html`: what a run came to, and how, as one file that needs nothing else.

It is made of the run's folder alone, so it can be made again at any time, also while the run
goes on: then it loads itself again every few seconds.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

from islandgp.bt.core.language import parse
from islandgp.bt.export.render import drawing, lay_out
from islandgp.errors import RunError
from islandgp.gp.archive import ArchiveSettings, Elite
from islandgp.records.archive_file import NAME, read_archive
from islandgp.records.checkpoint import read_checkpoint
from islandgp.records.folder import RunFolder, Status
from islandgp.redaction import HIDDEN
from islandgp.resources import program
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import in_words
from islandgp.text import title
from islandgp.viewer.ancestry import Lineage, LineageStep, lineage
from islandgp.viewer.champion import first_episode
from islandgp.viewer.history import RunHistory, read_history, thinned
from islandgp.viewer.page import filled, part, script_data
from islandgp.viewer.recording import digits

NAME_OF_PAGE: Final = "run.html"
RELOAD: Final = 5  # s between two looks of the page at itself while the run goes on
STEPS: Final = (6, 34)  # of a long lineage, the first and the last that are shown
REPLAY_BYTES: Final = 700_000  # of a replay that is part of the page
TREE_BYTES: Final = 500_000  # of the archive's trees that are part of the page; the best come first
NOTE: Final = 300  # characters of a supervisor's reasons
WORLD_GROUPS: Final = frozenset(
    {"domain", "world", "rewards", "curriculum", "classes", "experiment", "search"}
)
"""Groups of the configuration on which an episode may depend."""


@dataclass(frozen=True, slots=True)
class _Look:
    """What all parts of the page need."""

    folder: RunFolder
    status: Status
    config: Mapping[str, Any]
    history: RunHistory
    champion: Mapping[str, Any] | None  # an individual's record
    validation: Mapping[str, Any] | None
    digits: int  # behind the point, of points

    def points(self, value: float, sign: str = "") -> str:
        """Points as text."""
        return f"{value:{sign},.{self.digits}f}"


def run_page(folder: RunFolder, status: Status, *, replay: str = "", now: int = 0) -> str:
    """The page of a run as its folder is.

    Args:
        folder: that has a configuration.
        status: of the run; while it is RUNNING the page loads itself again.
        replay: a replay page of the best robot; "" for none.
        now: ms since 1970.

    Raises:
        RunError: a file of the folder is damaged.
    """
    history = read_history(folder)
    champion, validation = history.fittest, None
    if status is Status.FINISHED:
        best = folder.summary()["champion"]
        champion, validation = best["record"], best["validation"]
    values = [] if champion is None else [champion["fitness"], *champion["components"].values()]
    config = folder.configuration()
    look = _Look(folder, status, config, history, champion, validation, digits(values))
    about = folder.about()
    name = folder.path.name if about is None else about.title
    replay = replay if len(replay.encode()) <= REPLAY_BYTES else ""
    data = {
        "status": status.value,
        "updated": now,
        "reload": RELOAD,
        "digits": look.digits,
        "curves": thinned(history),
        "archive": _archive(look),
    }
    reload = f'<noscript><meta http-equiv="refresh" content="{RELOAD}"></noscript>'
    return filled(
        "run.html",
        {
            "title": escape(name),
            "style": part("palette.css") + part("run.css"),
            "reload": reload if status is Status.RUNNING else "",
            "status": status.value,
            "state": status.value.lower(),
            "result": escape(_result(look)),
            "facts": "".join(_facts(look)),
            "champion": "".join(_champion(look, has_replay=bool(replay))),
            "lineage": "".join(_lineage(look)),
            "data": script_data(data),
            "replay": script_data(replay),
            "script": part("run.js"),
        },
    )


def _result(look: _Look) -> str:
    """The run in a sentence or two."""
    done, history = look.history.generations, look.history
    if look.champion is None:
        return "The run has begun; its first generation is not evaluated yet."
    spent = f"{done:,} generation{'s' * (done != 1)} and {history.episodes[-1]:,.0f} episodes"
    if look.status is Status.FINISHED:
        return f"{_best_robot(look)} after {spent}.{_milestones(look)}{_constrained(look)}"
    points = look.points(look.champion["fitness"])
    best = f"the fittest individual of this stage, {look.champion['id']}, has {points} points"
    total = int(look.config["gp"]["generations"])
    if look.status is Status.RUNNING:
        return f"After {done:,} of {total:,} generations, {spent.partition(' and ')[2]}, {best}."
    if look.status is Status.FAILED:
        return f"The run failed after {spent}: {look.folder.reason()} Until then {best}."
    return f"The run was stopped after {spent}; its command goes on. Until then {best}."


def _best_robot(look: _Look) -> str:
    assert look.champion is not None
    v, name = look.validation, f"The best robot, individual {look.champion['id']},"
    if v is None:
        fitness = look.points(look.champion["fitness"])
        return f"{name} has {fitness} points in training, not validated in other worlds,"
    n = len(v["worlds"])
    between = (
        f" (95\N{NO-BREAK SPACE}%: {look.points(v['low'])} to {look.points(v['high'])})"
        if n > 1
        else ""
    )
    worlds = f"{n} unseen world{'s' * (n != 1)}"
    text = f"{name} earns {look.points(v['mean'])} points in {worlds}{between}"
    if v["yardstick"]:
        text += f", {look.points(v['difference'], '+')} against the tree {v['yardstick']},"
    return text


def _milestones(look: _Look) -> str:
    """Which tiers the best robot reaches in worlds that trained nobody."""
    if look.validation is None:
        return ""
    reached = look.validation["reached"]
    shares = [f"{title(tier)} in {share:.0%}" for tier, share in reached.items() if share]
    if not shares:
        return " It reaches no tier in these worlds."
    return f" In these worlds it is {', '.join(shares)}."


def _constrained(look: _Look) -> str:
    """Whether the best robot keeps the constraints in these worlds; "" without any."""
    if look.validation is None or look.validation.get("feasible") is None:
        return ""
    kept = "breaks" if look.validation["violation"] else "keeps"
    share = f"{look.validation['feasible']:.0%}"
    return f" On average it {kept} the constraints, and it keeps them in {share} of these worlds."


def _facts(look: _Look) -> Iterator[str]:
    about, config = look.folder.about(), look.config
    facts = {
        "domain": "" if about is None else about.tags.get("domain", ""),
        "search": str(config.get("search", {}).get("name", "paper")),
        "supervisor": str(config["supervisor"]["name"]),
        "constraints": in_words(look.history.constraints),
        "seed": str(config["seed"]),
        "version": "" if about is None else about.tags.get("code", ""),
        "in generations": _duration(look.history.seconds),
        "command": "" if about is None else about.command,
    }
    for name, value in facts.items():
        if value:
            shown = f"<code>{escape(value)}</code>" if name == "command" else escape(value)
            yield f"<div><dt>{name}</dt><dd>{shown}</dd></div>"


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min {rest} s"


def _elites(look: _Look) -> tuple[Elite, ...] | None:
    """The archive as far as the run has come; None where none can be read."""
    path = look.folder.path
    try:
        if look.status is Status.FINISHED:
            return read_archive(path)[0].elites
        for name in ("checkpoint.json", "checkpoint.previous.json"):
            if (path / name).exists():
                return read_checkpoint(path / name)[0].archive
    except RunError:  # it is missing or damaged, or being written
        return None
    return ()


def _archive(look: _Look) -> dict[str, Any] | None:
    """The map of the archive; None where the run keeps none."""
    if not look.history.archived:
        return None
    settings = ArchiveSettings.model_validate(look.config.get("archive") or {})
    axes = settings.axes(Classes.model_validate(look.config["classes"]))
    found = _elites(look)
    elites = sorted(found or (), key=lambda e: (-e.stage, -e.mean, e.cell))
    room, shown = TREE_BYTES, []
    for e in elites:
        room -= len(e.tree.encode())
        shown.append({**asdict(e), "stage": e.stage + 1, "tree": e.tree if room >= 0 else None})
    about = look.folder.about()
    return {
        "axes": [{"name": name, "edges": edges} for name, edges in axes.items()],
        "floor": settings.floor,
        "domain": "" if about is None else about.tags.get("domain", ""),
        "command": " ".join([shlex.quote(program()), "replay", "-"]),
        "flags": _world_flags(look),
        "file": NAME,
        "readable": found is not None,
        "elites": shown,
    }


def _world_flags(look: _Look) -> str:
    """The options with which a command plays in this run's world."""
    about = look.folder.about()
    try:
        words = [] if about is None else shlex.split(about.command)
    except ValueError:  # the quotes of a damaged file
        words = []
    flags: list[str] = []
    for k, word in enumerate(words):
        group = word.lstrip("+~").partition("=")[0].partition(".")[0].partition("/")[0]
        if word == "--config-dir":
            flags += words[k : k + 2]
        elif word.startswith("--config-dir="):
            flags.append(word)
        elif "=" in word and group in WORLD_GROUPS and HIDDEN not in word:
            flags += ["--set", word]
    return shlex.join(flags)


def _champion(look: _Look, *, has_replay: bool) -> Iterator[str]:
    """The best robot's tree, where its points come from, and its replay."""
    best = look.champion
    if best is None:
        yield "<p>None yet.</p>"
        return
    boxes, width, height = lay_out(parse(best["tree"]))
    if look.status is Status.FINISHED:
        yield f"<p>Individual {escape(best['id'])}, the best robot of the run.</p>"
    else:
        yield f"<p>Individual {escape(best['id'])}, the fittest of the present stage so far.</p>"
    yield (
        '<div class="picture" tabindex="0" role="region" aria-label="Picture of the tree">'
        f'<svg class="bt" role="img" aria-label="Behaviour tree of {len(boxes)} nodes"'
        f' width="{width:g}" height="{height:g}" viewBox="0 0 {width:g} {height:g}">'
        f"{drawing(boxes)}</svg></div>"
        f"<details><summary>As text ({best['nodes']} nodes)</summary>"
        f"<pre>{escape(best['tree'])}</pre></details>"
    )
    yield '<div class="tables">'
    yield _table("Points in training", _points(look, best))
    yield _table("Counters", ((name, f"{value:,.4g}") for name, value in best["counters"].items()))
    yield "</div>"
    if has_replay:
        yield (
            '<p><button id="show-replay" type="button">Show its replay</button></p>'
            '<div id="replay-place"></div>'
        )
    place = first_episode(look.folder, best["id"])
    file = shlex.quote(str(_from_home(look) / "best.bt"))
    flags = f" {flags}" if (flags := _world_flags(look)) else ""
    yield _command(
        "A replay as a file" if has_replay else "Its replay",
        f"{shlex.quote(program())} replay {file} --seed {place.seed}"
        f" --stage {place.stage + 1}{flags}",
    )


def _from_home(look: _Look) -> Path:
    """The run's folder as a command given where the run was started names it."""
    about, path = look.folder.about(), look.folder.path
    home = Path("/" if about is None else about.home)
    return path.relative_to(home) if path.is_relative_to(home) else path


def _points(look: _Look, best: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    parts = sorted(best["components"].items(), key=lambda part: -abs(part[1]))
    yield from ((name, look.points(value, "+")) for name, value in parts if value)
    yield "fitness", look.points(best["fitness"])


def _table(caption: str, rows: Iterator[tuple[str, str]]) -> str:
    body = "".join(
        f'<tr><th scope="row">{escape(name.replace("_", " "))}</th><td>{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f"<table><caption>{escape(caption)}</caption><tbody>{body}</tbody></table>"


def _command(label: str, text: str) -> str:
    return (
        f'<p class="command"><span>{escape(label)}:</span> <code>{escape(text)}</code>'
        ' <button type="button" class="copy">copy</button></p>'
    )


def _lineage(look: _Look) -> Iterator[str]:
    """How the champion came to be, a list item a tree."""
    if look.champion is None:
        yield "<p>None yet.</p>"
        return
    found = lineage(look.folder, look.champion["id"])
    yield f"<p>{escape(_chain(found))}</p>"
    first, last = STEPS
    steps = found.steps
    gains = [abs(s.gain) for s in steps if s.gain is not None]
    most = max(gains, default=0.0) or 1.0
    yield '<ol class="lineage">'
    if len(steps) > first + last:
        yield from (_item(look, step, most) for step in steps[:first])
        left = len(steps) - first - last
        yield f'<li class="gap">{left:,} trees between these are not shown.</li>'
        steps = steps[-last:]
    yield from (_item(look, step, most) for step in steps)
    yield "</ol>"


def _chain(found: Lineage) -> str:
    """What can be said of all steps."""
    steps = found.steps
    if not steps:
        return "The records of its generation are missing."
    if len(steps) == 1:
        text = f"It was made in one step: {_origin(steps[0])}."
    else:
        up = sum((s.gain or 0) > 0 for s in steps)
        text = (
            f"{len(steps):,} trees in {steps[-1].generation + 1:,} generations, each made of the"
            f" one before; {up:,} of them brought points."
        )
    if not found.whole:
        text += " What was before the first of them is not known."
    return text + (
        " A gain is to the parent in the same worlds where it says so; else the worlds differ, and"
        " part of it is luck." * any(s.gain is not None for s in steps)
    )


def _item(look: _Look, step: LineageStep, most: float) -> str:
    kind, gain = "none", ""
    if step.gain is not None:
        kind = "up" if step.gain > 0 else "down" if step.gain < 0 else "even"
        where = "same worlds" if step.same_worlds else "other worlds"
        width = 100 * abs(step.gain) / most
        gain = (
            f'<span class="gain">{look.points(step.gain, "+" if step.gain else "")}'
            f" <small>{where}</small></span>"
            f'<span class="bar" style="width:{width:.1f}%"></span>'
        )
    elif step.parents:
        gain = '<span class="gain"><small>another stage</small></span>'
    kept = ""
    if step.until > step.generation:
        kept = f", kept to generation {step.until} (mean of {step.evaluated} evaluations)"
    return (
        f'<li class="{kind}"><div class="head"><b>{escape(step.id)}</b>'
        f"<span>{escape(_origin(step))}</span>{gain}</div>"
        f'<p class="soft">{look.points(step.fitness)} points, {step.nodes} nodes{kept}</p>'
        f"{_guidance(step)}{_changes(step)}</li>"
    )


def _origin(step: LineageStep) -> str:
    """How a tree came to be, in words."""
    names = [name for name, _ in step.parents]
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
    why = str(step.guidance.get("rationale") or step.guidance.get("reasoning") or "")
    why = why if len(why) <= NOTE else f"{why[:NOTE]} ..."
    return f'<p class="soft">{escape(why)}</p>' if why else ""


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
    counts = _counts(step.changes, marks)
    body = "\n".join(lines)
    return f'<details><summary>{counts}</summary><pre class="diff">{body}</pre></details>'


def _counts(changes: Sequence[Any], marks: Mapping[str, str]) -> str:
    """How many nodes of each kind of change, e.g. `2 deleted, 1 inserted`."""
    counts = {word: sum(c.mark == mark for c in changes) for mark, word in marks.items()}
    return "What changed: " + ", ".join(f"{n} {word}" for word, n in counts.items() if n)
