"""A run's page, `run.html`: the best robot, curves, archive and lineage in one file.

It is created from the run's folder, at any time. The page of an active run reloads itself every few
seconds.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from html import escape
from pathlib import Path
from typing import Any, Final

from pydantic import ValidationError

from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, size
from islandgp.bt.export.render import label
from islandgp.domain import RewardTable
from islandgp.errors import RunError
from islandgp.gp.archive import ArchiveSettings, Elite
from islandgp.records.archive_file import NAME, read_archive
from islandgp.records.checkpoint import read_checkpoint
from islandgp.records.folder import RunFolder, Status
from islandgp.records.sentences import best_robot_in_a_sentence, constrained, reached
from islandgp.redaction import HIDDEN
from islandgp.resources import program
from islandgp.scoring.classes import Classes
from islandgp.scoring.constraints import in_words
from islandgp.text import in_interval, in_points
from islandgp.viewer.champion import first_episode
from islandgp.viewer.history import RunCurves, nothing_works, read_history, thinned
from islandgp.viewer.lineage import lineage_section
from islandgp.viewer.page import filled, part, script_data

NAME_OF_PAGE: Final = "run.html"
RELOAD: Final = 5  # s between two reloads of an active run's page
REPLAY_BYTES: Final = 700_000  # largest replay that is embedded in the page


WORLD_GROUPS: Final = frozenset(
    {"domain", "world", "rewards", "curriculum", "classes", "experiment", "search"}
)
"""Groups of the configuration on which an episode may depend."""


@dataclass(frozen=True, slots=True)
class RunView:
    """A run as read from its folder, for all parts of its page."""

    folder: RunFolder
    status: Status
    config: Mapping[str, Any]
    history: RunCurves
    champion: Mapping[str, Any] | None  # an individual's record
    summary: Mapping[str, Any] | None  # of a finished run


def run_page(
    folder: RunFolder,
    status: Status,
    curves: RunCurves | None = None,
    *,
    replay: str = "",
    now: int = 0,
) -> str:
    """The page of a run, from the present content of its folder.

    Args:
        folder: of the run; it must have a configuration.
        status: of the run; the page of a RUNNING one reloads itself.
        curves: of the generations in the folder; None: they are read from it.
        replay: a replay page of the best robot; "" for none.
        now: ms since 1970.

    Raises:
        RunError: a file of the folder is damaged.
    """
    history = read_history(folder) if curves is None else curves
    champion, summary = history.fittest, None
    if status is Status.FINISHED:
        summary = folder.summary()
        champion = {**summary["champion"]["record"], "tree": summary["champion"]["tree"]}
    view = RunView(folder, status, folder.configuration(), history, champion, summary)
    about = folder.about()
    name = folder.path.name if about is None else about.title
    replay = replay if len(replay.encode()) <= REPLAY_BYTES else ""
    data = {
        "status": status.value,
        "updated": now,
        "reload": RELOAD,
        "curves": thinned(history),
        "archive": archive_map(view),
        "front": [] if summary is None else summary["champion"]["front"],
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
            "result": _unbroken(_result(view)),
            "notes": "".join(_notes(view)),
            "open": "" if status is Status.FINISHED else "open",
            "champion": "".join(champion_section(view)),
            "training": "".join(_training(view)),
            "facts": "".join(_facts(view)),
            "lineage": "".join(lineage_section(folder, champion["id"]) if champion else ()),
            "data": script_data(data),
            "replay": script_data(replay),
            "script": part("run.js"),
        },
    )


def _unbroken(text: str) -> str:
    """A text as HTML that no line break divides before a per cent sign."""
    return escape(text).replace(" %", "&nbsp;%")


def _result(view: RunView) -> str:
    """The result of the run in one sentence."""
    history = view.history
    if view.champion is None:
        return "The run has begun; its first generation is not evaluated yet."
    if view.summary is not None:
        return best_robot_in_a_sentence(view.summary["champion"])
    spent, points = _spent(view), in_points(view.champion["fitness"])
    best = f"the fittest individual of this stage, {view.champion['id']}, has {points} points"
    total = int(view.config["gp"]["generations"])
    if view.status is Status.RUNNING:
        of = f"{history.generations:,} of {total:,} generations"
        return f"After {of}, {history.episodes[-1]:,.0f} episodes, {best}."
    if view.status is Status.FAILED:
        return f"The run failed after {spent}: {view.folder.reason()} Until then {best}."
    return f"The run was stopped after {spent}; the same command continues it. Until then {best}."


def _spent(view: RunView) -> str:
    done = view.history.generations
    plural = "s" * (done != 1)
    return f"{done:,} generation{plural} and {view.history.episodes[-1]:,.0f} episodes"


def _notes(view: RunView) -> Iterator[str]:
    """More sentences on the result, as on the terminal, in HTML."""
    if view.history.generations and (warning := _nothing_works(view)):
        yield f'<p class="warning">{_unbroken(warning)}</p>'
    if view.summary is not None:
        notes = (*reached(view.summary["champion"]), *constrained(view.summary))
        yield f"<p>{_unbroken('. '.join((*notes, f'The run had {_spent(view)}.')))}</p>"


def _nothing_works(view: RunView) -> str:
    """A sentence on what no individual has achieved so far; "" if something works."""
    if view.summary is not None:
        return str(view.summary.get("nothing_works", ""))
    try:
        rewards = RewardTable.model_validate(view.config["rewards"])
    except (KeyError, ValidationError):  # a domain's own rewards
        rewards = None
    classes = Classes.model_validate(view.config["classes"])
    return nothing_works(view.history, classes, rewards, view.config["search"]["name"])


def _facts(view: RunView) -> Iterator[str]:
    about, config = view.folder.about(), view.config
    facts = {
        "domain": "" if about is None else about.tags.get("domain", ""),
        "search": str(config.get("search", {}).get("name", "paper")),
        "supervisor": str(config["supervisor"]["name"]),
        "constraints": in_words(view.history.constraints),
        "seed": str(config["seed"]),
        "version": "" if about is None else about.tags.get("code", ""),
        "in generations": _duration(view.history.seconds),
        "command": "" if about is None else about.command,
    }
    for name, value in facts.items():
        if value:
            value_html = f"<code>{escape(value)}</code>" if name == "command" else escape(value)
            yield f"<div><dt>{name}</dt><dd>{value_html}</dd></div>"


def _duration(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.1f} s"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min {rest} s"


TREE_BYTES: Final = 500_000  # most bytes of embedded trees of the archive, the best first


def archive_map(view: RunView) -> dict[str, Any] | None:
    """The map of the archive; None before the first generation."""
    if not view.history.generations:
        return None
    settings = ArchiveSettings.model_validate(view.config["archive"])
    axes = settings.axes(Classes.model_validate(view.config["classes"]))
    cells = _elites(view)
    elites = sorted(cells or (), key=lambda e: (-e.stage, -e.mean, e.cell))
    room, entries = TREE_BYTES, []
    for e in elites:
        room -= len(e.tree.encode())
        entries.append({**asdict(e), "stage": e.stage + 1, "tree": e.tree if room >= 0 else None})
    about = view.folder.about()
    return {
        "axes": [{"name": name, "edges": edges} for name, edges in axes.items()],
        "floor": settings.floor,
        "domain": "" if about is None else about.tags.get("domain", ""),
        "command": " ".join([shlex.quote(program()), "replay", "-"]),
        "flags": _world_flags(view),
        "file": NAME,
        "readable": cells is not None,
        "elites": entries,
    }


def _world_flags(view: RunView) -> str:
    """The command-line options for this run's world."""
    about = view.folder.about()
    try:
        arguments = [] if about is None else shlex.split(about.command)
    except ValueError:  # the quotes of a damaged file
        arguments = []
    flags: list[str] = []
    for k, word in enumerate(arguments):
        group = word.lstrip("+~").partition("=")[0].partition(".")[0].partition("/")[0]
        if word == "--config-dir":
            flags += arguments[k : k + 2]
        elif word.startswith("--config-dir="):
            flags.append(word)
        elif "=" in word and group in WORLD_GROUPS and HIDDEN not in word:
            flags += ["--set", word]
    return shlex.join(flags)


def _elites(view: RunView) -> tuple[Elite, ...] | None:
    """The present archive; None if it cannot be read."""
    path = view.folder.path
    try:
        if view.status is Status.FINISHED:
            return read_archive(path)[0].elites
        for name in ("checkpoint.json", "checkpoint.previous.json"):
            if (path / name).exists():
                return read_checkpoint(path / name)[0].archive
    except RunError:  # the file is missing, damaged, or being written
        return None
    return ()


def embedded_replay(text: str) -> str:
    """The replay that the text of a run's page holds; "" for none."""
    match = re.search(r'<script type="application/json" id="replay">(.*)</script>', text)
    return str(json.loads(match[1])) if match else ""


def champion_section(view: RunView) -> Iterator[str]:
    """The HTML of the best robot: its tree with what each node does and is worth."""
    best = view.champion
    if best is None:
        yield "<p>None yet.</p>"
        return
    champion = {} if view.summary is None else view.summary["champion"]
    tree, usages = parse(best["tree"]), champion.get("usage", ())
    nodes = size(tree)
    if view.summary is None:
        yield f"<p>Individual {escape(best['id'])}, the fittest of the present stage so far.</p>"
    columns = "<span>worlds</span><span>points</span><span>without it</span>" if usages else ""
    yield f'<div class="row use"><b>{nodes} node{"s" * (nodes != 1)}</b>{columns}</div>'
    losses = [abs(u["loss"]["mean"]) for u in usages if u["loss"]]
    most = max(losses, default=0.0) or 1.0
    notes = iter(usages if len(usages) == nodes else ())
    yield f'<ul class="tree">{_tree(tree, notes, most)}</ul>'
    if usages:
        yield (
            '<p class="soft">Means over unseen worlds: the share of worlds in which a node runs,'
            " the points of the actions below it, and the change of the tree's points without it,"
            " with a 95 % interval.</p>"
        )
    text = champion.get("text", best["tree"])
    yield f"<details><summary>As text</summary><pre>{escape(text)}</pre></details>"
    about, path = view.folder.about(), view.folder.path / "best.bt"
    home = Path("/" if about is None else about.home)
    file = shlex.quote(str(path.relative_to(home) if path.is_relative_to(home) else path))
    flags = f" {flags}" if (flags := _world_flags(view)) else ""
    seed, stage = first_episode(view.folder, best["id"])
    command = f"{program()} replay {file} --seed {seed} --stage {stage + 1}{flags}"
    yield (
        f"<details><summary>Its replay as a command</summary><p><code>{escape(command)}</code>"
        ' <button type="button" class="copy">copy</button></p></details>'
    )


def _tree(node: Node, usages: Iterator[Mapping[str, Any]], most: float) -> str:
    """A node with its descendants as nested list items; `most` is the loss with the longest bar."""
    usage = next(usages, None)
    columns, quiet = "", ""
    if usage is not None and not usage["worlds"]:
        columns, quiet = "<span></span><span></span><span>never runs</span>", " quiet"
    elif usage is not None:
        points = in_points(usage["points"]) if usage["points"] else ""
        cells = (f"{usage['worlds']:.0%}", points, _loss(usage, most))
        columns = "".join(f"<span>{cell}</span>" for cell in cells)
    children = "".join(_tree(child, usages, most) for child in node.children)
    return (
        f'<li><div class="row{quiet}"><span class="node {node.kind}"'
        f' title="{escape(kind_of(node).meaning)}">{escape(label(node))}</span>{columns}</div>'
        + (f"<ul>{children}</ul>" if children else "")
        + "</li>"
    )


def _loss(usage: Mapping[str, Any], most: float) -> str:
    """The change of points without a node, with its interval and a bar."""
    if (loss := usage["loss"]) is None:
        return ""
    low, high = (None if loss[end] is None else -loss[end] for end in ("high", "low"))
    width = 100 * abs(loss["mean"]) / most
    return f'{in_interval(-loss["mean"], low, high)}<i style="width:{width:.0f}%"></i>'


def _training(view: RunView) -> Iterator[str]:
    """The HTML of the best robot's points and counters in training."""
    best = view.champion
    if best is None:
        yield "<p>None yet.</p>"
        return
    parts = sorted(best["components"].items(), key=lambda part: -abs(part[1]))
    points = [(name, in_points(value, "+")) for name, value in parts if value]
    fitness = ("fitness", in_points(best["fitness"]))
    counters = ((name, f"{value:,.4g}") for name, value in best["counters"].items())
    yield f'<p>Individual {escape(best["id"])}, as it was in training.</p><div class="tables">'
    yield _table("Points", [*points, fitness])
    yield _table("Counters", counters)
    yield "</div>"


def _table(caption: str, rows: Iterable[tuple[str, str]]) -> str:
    body = "".join(
        f'<tr><th scope="row">{escape(name.replace("_", " "))}</th><td>{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f"<table><caption>{escape(caption)}</caption><tbody>{body}</tbody></table>"
