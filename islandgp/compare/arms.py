"""Arms: runs that differ only in their seed, selected by settings or taken from a sweep."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import yaml

from islandgp.compare.runs import Run, RunEntry, read
from islandgp.errors import StudyError
from islandgp.sweep.folder import SweepFolder

SHORT_KEYS: Final = {
    "supervisor": "supervisor.name",
    "search": "search.name",
    "evaluator": "evaluator.factory",
}
"""Short names in selections, with the keys of the configuration."""

UNSUPERVISED: Final = "baseline"
"""The supervisor that does not guide the search; its arms are the last of a sweep."""

MAX_NAME: Final = 80  # most characters of an arm's name

_RANGE = re.compile(r"range\((\d+)(?:,\s*(\d+))?\)")
_PART = re.compile(r"""(?:\([^)]*\)|\[[^]]*\]|'[^']*'|"[^"]*"|\S)+""")
"""A part of a selection; it may contain spaces in brackets and quotes."""


@dataclass(frozen=True, slots=True)
class Arm:
    """Runs that differ only in their seed."""

    name: str
    selection: str  # text of the --arm option, or the overrides of a sweep's arm
    runs: tuple[Run, ...]  # by seed
    keys: frozenset[str] = frozenset()  # of the configuration, in which it may differ from others
    levels: Mapping[str, str] = field(default_factory=dict)  # its values of these keys, if single

    @property
    def seeds(self) -> tuple[int, ...]:
        """The seeds of the runs, in order."""
        return tuple(r.seed for r in self.runs)

    @property
    def generations(self) -> int:
        """Number of generations of the shortest run."""
        return min(len(r.records) for r in self.runs)


@dataclass(frozen=True, slots=True)
class Selection:
    """Settings that an arm's runs have in common, by dotted key."""

    text: str
    conditions: tuple[tuple[str, Any], ...]  # a key, and a value or a range of values

    @property
    def keys(self) -> frozenset[str]:
        """The selected keys."""
        return frozenset(key for key, _ in self.conditions)

    def matches(self, run: RunEntry) -> bool:
        """True if a run has all of the settings."""
        return all(
            key in run.flat
            and (
                run.flat[key] in value if isinstance(value, range) else _equal(run.flat[key], value)
            )
            for key, value in self.conditions
        )


def parse_selection(text: str) -> Selection:
    """`supervisor=expert gp.population=30`, separated by spaces; a bare word is a sweep's name.

    A value is YAML, or `range(30)` or `range(100, 130)` for each number in the range.
    """
    conditions = []
    for part in _PART.findall(text):
        key, equals, value = part.partition("=")
        if not equals:
            key, value = "name", part
        conditions.append((SHORT_KEYS.get(key, key), _value(value)))
    return Selection(text, tuple(conditions))


def _value(text: str) -> Any:
    if re.match(r"range(\(|$)", text) and not _RANGE.fullmatch(text):
        raise StudyError(f"Expected range(N) or range(M, N), found {text}.")
    if match := _RANGE.fullmatch(text):
        first, last = match.groups()
        return range(int(first)) if last is None else range(int(first), int(last))
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return text


def _equal(recorded: Any, selected: Any) -> bool:
    """True if a recorded value equals the value in a selection; numbers in any notation.

    YAML reads `1e-1` as text; compared with a recorded number, it is a number.
    """
    if isinstance(recorded, list) and isinstance(selected, list):
        return len(recorded) == len(selected) and all(map(_equal, recorded, selected))
    if isinstance(recorded, int | float) and isinstance(selected, str):
        try:
            return recorded == float(selected)
        except ValueError:
            return str(recorded) == selected
    return recorded == selected or str(recorded) == str(selected)


def select_arms(texts: Sequence[str], runs: Sequence[RunEntry]) -> tuple[list[Arm], list[str]]:
    """The arms of the --arm options, with notes on the runs that are left out.

    Args:
        texts: each is NAME=SELECTION, or the name of an arm of a sweep as it is printed.
        runs: the available ones.

    Raises:
        StudyError: a text is neither, or no finished run matches; the message lists the runs.
    """
    by_label, _, keys = _by_arm(runs)
    labels = {_words(label): label for label in by_label}
    arms: list[Arm] = []
    notes: list[str] = []
    for text in texts:
        if label := labels.get(_words(text)):
            members, levels = by_label[label]
            arm, remarks = _arm(label, label, members, keys, levels)
        else:
            name, condition = parse_arm(text, list(by_label))
            arm, remarks = _selected(name, condition, runs)
        arms.append(arm)
        notes += remarks
    return arms, notes


def _words(label: str) -> frozenset[str]:
    """The parts of an arm's name; their order and case do not matter."""
    return frozenset(label.lower().split())


def parse_arm(text: str, labels: Sequence[str] = ()) -> tuple[str, str]:
    """`expert=supervisor=expert` as ("expert", "supervisor=expert").

    Raises StudyError, with the names of the arms in `labels`, for another text.
    """
    name, _, selection = text.partition("=")
    if len(name.strip()) > MAX_NAME:
        raise StudyError(
            f"Expected an arm's name of at most {MAX_NAME} characters, found {len(name.strip())}:"
            f" {name.strip():.20}..."
        )
    if not re.fullmatch(r"\w[\w.+-]*", name.strip()) or not selection.strip():
        raise StudyError(
            f'Expected --arm NAME="KEY=VALUE ..." or an arm of a sweep, found {text!r};'
            ' for instance --arm expert="supervisor=expert".'
            + f" The arms are {', '.join(map(repr, labels))}."
            * bool(labels)
        )
    return name.strip(), selection.strip()


def _selected(name: str, text: str, runs: Sequence[RunEntry]) -> tuple[Arm, tuple[str, ...]]:
    selection = parse_selection(text)
    fitting = [run for run in runs if selection.matches(run)]
    if not any(run.finished for run in fitting):
        raise StudyError(_nothing(name, selection, runs, len(fitting)))
    levels = {
        key: str(value)
        for key, value in selection.conditions
        if key not in ("name", "seed") and not isinstance(value, range)
    }
    return _arm(name, text, fitting, selection.keys, levels)


def arms_of_sweep(runs: Sequence[RunEntry]) -> tuple[list[Arm], list[str]]:
    """The arms of a sweep, with notes on omitted runs.

    An arm has the runs that differ only in their seed; it has the name that the sweep prints.
    Arms without a supervisor (`baseline`) are the last.

    Raises:
        StudyError: the runs are of several sweeps, or have fewer than two arms with finished runs.
    """
    if len(names := sorted({str(run.flat["name"]) for run in runs})) > 1:
        raise StudyError(
            f"Expected --name or --arm, as there are runs of {len(names)} sweeps, found neither.\n"
            "There are:\n  " + "\n  ".join(overview(runs))
        )
    by_label, notes, keys = _by_arm(runs)
    finished = {
        label: each for label, each in by_label.items() if any(run.finished for run in each[0])
    }
    if len(finished) < 2:
        unfinished = sum(not run.finished for members, _ in by_label.values() for run in members)
        more = f" (unfinished runs: {unfinished})" if unfinished else ""
        raise StudyError(
            f"Expected two arms or more with finished runs, found {', '.join(finished) or 'none'}"
            f"{more}; run a sweep such as supervisor=baseline,expert, or select arms by --arm."
        )
    arms: list[Arm] = []
    for label in sorted(finished, key=lambda label: label.split()[0] == UNSUPERVISED):
        members, levels = finished[label]
        arm, remarks = _arm(label, label, members, keys, levels)
        arms.append(arm)
        notes += remarks
    return arms, notes


Members = dict[str, tuple[list[RunEntry], Mapping[str, str]]]
"""The runs of each arm and the values of its factors, by label."""


def _by_arm(runs: Sequence[RunEntry]) -> tuple[Members, list[str], frozenset[str]]:
    """The runs by arm, a note on runs that are no jobs of their sweep, and the studied keys.

    Folders of one name are parts of one sweep, whose arms differ in what any part varies.
    """
    folders = {run.path.parent: SweepFolder(run.path.parent).read() for run in runs}
    jobs = {
        name: tuple(
            job for f, file in folders.items() if file and f.name == name for job in file.jobs
        )
        for name in {folder.name for folder in folders}
    }
    files = {f: file and replace(file, jobs=jobs[f.name]) for f, file in folders.items()}
    members: Members = {}
    others: list[str] = []
    for run in runs:
        file = files[run.path.parent]
        label, levels = str(run.flat["supervisor.name"]), dict[str, str]()
        if file is not None:
            own = folders[run.path.parent] or file
            job = next((job for job in own.jobs if job.folder == run.path.name), None)
            if job is None:
                others.append(run.path.name)
                continue
            label, levels = file.arm(job), file.levels(job)
        members.setdefault(label, ([], levels))[0].append(run)
    order = [label for file in files.values() if file for label in file.arms()]
    members = dict(sorted(members.items(), key=lambda each: [*order, each[0]].index(each[0])))
    keys = frozenset[str]().union(*(file.studied_keys() for file in files.values() if file))
    notes = [f"{_some(others)} that are not jobs of the sweep are left out; --arm selects any run."]
    return members, notes if others else [], keys


def _some(names: Sequence[str]) -> str:
    """The number of runs, and the first three."""
    return f"{len(names)} runs ({', '.join(names[:3])}{', ...' * (len(names) > 3)})"


def _arm(
    name: str,
    text: str,
    runs: Sequence[RunEntry],
    keys: frozenset[str],
    levels: Mapping[str, str],
) -> tuple[Arm, tuple[str, ...]]:
    """The arm of the finished ones of these runs, and notes on the others."""
    finished = sorted((read(r) for r in runs if r.finished), key=lambda r: (r.seed, str(r.path)))
    unfinished = [r.path.name for r in runs if not r.finished]
    note = (
        f"{name}: {_some(unfinished)} are left out as unfinished; the command that started them"
        " finishes them."
    )
    return Arm(name, text, tuple(finished), keys, levels), (note,) if unfinished else ()


def named(name: str, runs: Sequence[RunEntry]) -> list[RunEntry]:
    """The runs of a sweep. Raises StudyError, with a list of the sweeps, if there is none."""
    matching = [run for run in runs if run.flat["name"] == name]
    if not matching:
        names = sorted({str(run.flat["name"]) for run in runs})
        raise StudyError(
            f"Expected runs of a sweep named {name}, found none;"
            + (f" there are {', '.join(names)}." if names else " there are no runs at all.")
        )
    return matching


def _nothing(name: str, selection: Selection, runs: Sequence[RunEntry], unfinished: int) -> str:
    if unfinished:
        return (
            f"Expected finished runs for {name}={selection.text!r}, found {unfinished} unfinished"
            " ones; start the same sweep again to finish them."
        )
    keys = {*SHORT_KEYS, *(key for run in runs for key in run.flat)}
    hints = [f" There is no key {key}." for key in sorted(selection.keys - keys)]
    table = overview(runs)
    return f"Expected runs for {name}={selection.text!r}, found none.{''.join(hints)}\n" + (
        "There are:\n  " + "\n  ".join(table) if table else "There are no runs at all."
    )


def overview(runs: Sequence[RunEntry]) -> list[str]:
    """A line for each sweep and supervisor of the existing runs."""
    groups: dict[tuple[str, str], list[RunEntry]] = defaultdict(list)
    for run in runs:
        groups[str(run.flat["name"]), str(run.flat["supervisor.name"])].append(run)
    lines = []
    for (name, supervisor), members in sorted(groups.items()):
        seeds = in_short(sorted({int(run.flat["seed"]) for run in members}))
        open_ones = sum(not run.finished for run in members)
        more = f", {open_ones} of them unfinished" if open_ones else ""
        lines.append(
            f"name={name} supervisor={supervisor}: {len(members)} runs, seeds {seeds}{more}"
        )
    return lines


def in_short(numbers: Sequence[int]) -> str:
    """Rising numbers as ranges: 0-4, 7."""
    spans: list[list[int]] = []
    for n in numbers:
        if spans and n == spans[-1][1] + 1:
            spans[-1][1] = n
        else:
            spans.append([n, n])
    return ", ".join(str(a) if a == b else f"{a}-{b}" for a, b in spans)
