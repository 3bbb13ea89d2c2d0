"""Arms: runs that differ only in their seed, selected by settings or taken from a sweep."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import yaml

from islandgp.errors import StudyError
from islandgp.plain import flatten
from islandgp.records.folder import run_folders
from islandgp.records.sweep import read_sweep
from islandgp.scoring.classes import Classes

SHORT_KEYS: Final = {
    "supervisor": "supervisor.name",
    "search": "search.name",
    "evaluator": "evaluator.factory",
}
"""Short names in selections, with the keys of the configuration."""

UNSUPERVISED: Final = "baseline"
"""The supervisor that does not guide the search; its arms are the last of a sweep."""

MAX_NAME: Final = 80  # most characters of an arm's name

_RANGE = re.compile(r"range\((?:(\d+),\s*)?(\d+)\)")
_PART = re.compile(r"""(?:\([^)]*\)|\[[^]]*\]|'[^']*'|"[^"]*"|\S)+""")
"""A part of a selection; it may contain spaces in brackets and quotes."""


@dataclass(frozen=True, slots=True)
class Run:
    """A run's folder with its configuration."""

    path: Path
    config: Mapping[str, Any]
    flat: Mapping[str, Any]  # the same by dotted key
    finished: bool = True

    @property
    def seed(self) -> int:
        """The run's seed."""
        return int(self.config["seed"])

    @property
    def classes(self) -> Classes:
        """The behaviours, classes and tiers of its individuals."""
        return Classes(**self.config["classes"])


@dataclass(frozen=True, slots=True)
class Arm:
    """Runs that differ only in their seed; in a comparison all of them are finished."""

    name: str
    selection: str  # text of the --arm option, or the overrides of a sweep's arm
    runs: tuple[Run, ...]  # by seed, then path
    keys: frozenset[str] = frozenset()  # of the configuration, in which it may differ from others
    levels: Mapping[str, str] = field(default_factory=dict)  # its values of these keys, if single

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of the runs, in order."""
        return tuple(run.seed for run in self.runs)


def find(folders: Sequence[Path], name: str | None = None) -> list[Run]:
    """All runs in some folders and those below them, without MLflow's copies of runs.

    `name`: only those of the sweep with this name.

    Raises:
        StudyError: there is no such folder, or no such sweep.
        RunError: a run's configuration is damaged.
    """
    runs: dict[Path, Run] = {}
    for folder in folders:
        if not folder.is_dir():
            raise StudyError(
                f"Expected runs in {folder}, found no such folder; run `python -m islandgp` first,"
                " or give another folder."
            )
        for run in run_folders(folder):
            if run.begun() and (run.path / "generations.jsonl").exists():
                config = run.configuration()
                found = Run(run.path, config, flatten(config), run.finished())
                runs[run.path.resolve()] = found
    chosen = [run for run in runs.values() if name in (None, run.flat["name"])]
    if name is not None and not chosen:
        raise StudyError(
            f"Expected runs of a sweep named {name}, found none.{_overview([*runs.values()])}"
        )
    return chosen


def parse_selection(text: str) -> dict[str, Any]:
    """`supervisor=expert gp.population=30`, separated by spaces; a bare word is a sweep's name.

    A value is YAML, or `range(30)` or `range(100, 130)` for each number in the range.

    Returns:
        The values and ranges by dotted key.
    """
    conditions: dict[str, Any] = {}
    for part in _PART.findall(text):
        key, equals, value = part.partition("=")
        if not equals:
            key, value = "name", part
        conditions[SHORT_KEYS.get(key, key)] = _value(value)
    return conditions


def _value(text: str) -> Any:
    if match := _RANGE.fullmatch(text):
        return range(int(match[1] or 0), int(match[2]))
    if re.match(r"range(\(|$)", text):
        raise StudyError(f"Expected range(N) or range(M, N), found {text}.")
    with suppress(yaml.YAMLError):
        return yaml.safe_load(text)
    return text


def matches(run: Run, conditions: Mapping[str, Any]) -> bool:
    """True if a run has all of the settings."""
    return all(key in run.flat and _equal(run.flat[key], v) for key, v in conditions.items())


def _equal(recorded: Any, selected: Any) -> bool:
    """True if a recorded value is the selected one, or in the selected range.

    YAML reads `1e-1` as text; compared with a recorded number, it is a number.
    """
    if isinstance(selected, range):
        return recorded in selected
    if isinstance(recorded, int | float) and isinstance(selected, str):
        with suppress(ValueError):
            return recorded == float(selected)
    return bool(recorded == selected or str(recorded) == str(selected))


def select_arms(texts: Sequence[str], runs: Sequence[Run]) -> tuple[list[Arm], list[str]]:
    """The arms of the --arm options, with notes on the runs that are left out.

    Args:
        texts: each is NAME=SELECTION, or the name of an arm of a sweep as it is printed.
        runs: the available ones.

    Raises:
        StudyError: a text is neither, or no finished run matches; the message lists the runs.
    """
    groups, _ = _by_arm(runs)
    labels = {_words(label): label for label in groups}
    arms = []
    for text in texts:
        if label := labels.get(_words(text)):
            arms.append(groups[label])
        else:
            arms.append(_selected(*parse_arm(text, list(groups)), runs))
    return _finished(arms)


def _finished(arms: Sequence[Arm]) -> tuple[list[Arm], list[str]]:
    """The arms with their finished runs, and notes on the others."""
    notes = [
        f"{arm.name}: {_some(others)} are left out as unfinished; the command that started them"
        " finishes them."
        for arm in arms
        if (others := [run.path.name for run in arm.runs if not run.finished])
    ]
    return [replace(a, runs=tuple(run for run in a.runs if run.finished)) for a in arms], notes


def _words(label: str) -> frozenset[str]:
    """The parts of an arm's name; their order and case do not matter."""
    return frozenset(label.lower().split())


def parse_arm(text: str, labels: Sequence[str] = ()) -> tuple[str, str]:
    """`expert=supervisor=expert` as ("expert", "supervisor=expert").

    Raises StudyError, with the names of the arms in `labels`, for another text.
    """
    name, _, selection = (part.strip() for part in text.partition("="))
    if len(name) > MAX_NAME or not re.fullmatch(r"\w[\w.+-]*", name) or not selection:
        raise StudyError(
            f'Expected --arm NAME="KEY=VALUE ..." with a name of at most {MAX_NAME} characters, or'
            f" an arm of a sweep, found {text!r:.200}; for instance --arm"
            ' expert="supervisor=expert".'
            + f" The arms are {', '.join(map(repr, labels))}."
            * bool(labels)
        )
    return name, selection


def _selected(name: str, text: str, runs: Sequence[Run]) -> Arm:
    """The arm of a selection. Raises StudyError if none of them is finished."""
    conditions = parse_selection(text)
    fitting = sorted(
        (run for run in runs if matches(run, conditions)), key=lambda run: (run.seed, run.path)
    )
    if not any(run.finished for run in fitting):
        known = {*SHORT_KEYS, *(key for run in runs for key in run.flat)}
        hints = "".join(f" There is no key {key}." for key in sorted({*conditions} - known))
        raise StudyError(
            f"Expected finished runs for {name}={text!r}, found"
            f" {f'{len(fitting)} unfinished ones' if fitting else 'none'}; repeat the command of"
            f" unfinished ones, or select others.{hints}" + _overview(runs)
        )
    levels = {
        key: str(value)
        for key, value in conditions.items()
        if key not in ("name", "seed") and not isinstance(value, range)
    }
    return Arm(name, text, tuple(fitting), frozenset(conditions), levels)


def arms_of_sweep(runs: Sequence[Run]) -> tuple[list[Arm], list[str]]:
    """The arms of a sweep, with notes on omitted runs.

    An arm has the runs that differ only in their seed; it has the name that the sweep prints.
    Arms without a supervisor (`baseline`) are the last.

    Raises:
        StudyError: the runs are of several sweeps, or have fewer than two arms with finished runs.
    """
    if len(names := {str(run.flat["name"]) for run in runs}) > 1:
        raise StudyError(
            f"Expected the runs of one sweep, found those of {len(names)}; give --name SWEEP,"
            " its folder, or select arms by --arm." + _overview(runs)
        )
    groups, notes = _by_arm(runs)
    finished = {name: g for name, g in groups.items() if any(run.finished for run in g.runs)}
    if len(finished) < 2:
        unfinished = sum(not run.finished for group in groups.values() for run in group.runs)
        more = f" (unfinished runs: {unfinished})" if unfinished else ""
        raise StudyError(
            f"Expected two arms or more with finished runs, found {', '.join(finished) or 'none'}"
            f"{more}; run a sweep such as supervisor=baseline,expert, or select arms by --arm."
        )
    order = sorted(finished, key=lambda label: label.split()[0] == UNSUPERVISED)
    arms, remarks = _finished([finished[label] for label in order])
    return arms, notes + remarks


def _by_arm(runs: Sequence[Run]) -> tuple[dict[str, Arm], list[str]]:
    """The runs by arm, and a note on runs that are no jobs of their sweep.

    Folders of one name are parts of one sweep, whose arms differ in what any part varies.
    """
    folders = dict.fromkeys(run.path.parent for run in runs)
    files = {folder: read_sweep(folder) for folder in folders}
    parts = {folder: file for folder, file in files.items() if file is not None}
    wholes = {
        folder: replace(
            file,
            jobs=tuple(j for f, part in parts.items() if f.name == folder.name for j in part.jobs),
        )
        for folder, file in parts.items()
    }
    keys = frozenset[str]().union(*(whole.studied_keys() for whole in wholes.values()))
    groups: dict[str, Arm] = {}
    others: list[str] = []
    for run in sorted(runs, key=lambda run: (run.seed, run.path)):
        label, levels = str(run.flat["supervisor.name"]), dict[str, str]()
        if whole := wholes.get(run.path.parent):
            jobs = {job.folder: job for job in parts[run.path.parent].jobs}
            if run.path.name not in jobs:
                others.append(run.path.name)
                continue
            job = jobs[run.path.name]
            label, levels = whole.arm(job), whole.levels(job)
        arm = groups.get(label, Arm(label, label, (), keys, levels))
        groups[label] = replace(arm, runs=(*arm.runs, run))
    order = [*(label for whole in wholes.values() for label in whole.arms()), *groups]
    note = f"{_some(others)} that are not jobs of the sweep are left out; --arm selects any run."
    return {name: groups[name] for name in dict.fromkeys(order) if name in groups}, [note] * bool(
        others
    )


def _some(names: Sequence[str]) -> str:
    """The number of runs, and the first three."""
    return f"{len(names)} runs ({', '.join(names[:3])}{', ...' * (len(names) > 3)})"


def _overview(runs: Sequence[Run]) -> str:
    """A line per sweep and supervisor: which runs there are."""
    groups: dict[str, list[Run]] = {}
    for run in runs:
        label = f"name={run.flat['name']} supervisor={run.flat['supervisor.name']}"
        groups.setdefault(label, []).append(run)
    lines = []
    for label, members in sorted(groups.items()):
        unfinished = sum(not run.finished for run in members)
        rest = f", {unfinished} unfinished" if unfinished else ""
        seeds = in_short(sorted({run.seed for run in members}))
        lines.append(f"  {label}: {len(members)} runs, seeds {seeds}{rest}")
    return "\n" + "\n".join(["There are:", *lines] if lines else ["There are no runs at all."])


def in_short(numbers: Sequence[int]) -> str:
    """Rising numbers as ranges: 0-4, 7."""
    spans: list[list[int]] = []
    for n in numbers:
        if spans and n == spans[-1][1] + 1:
            spans[-1][1] = n
        else:
            spans.append([n, n])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in spans)
