"""Selection of an arm's runs by `key=value` pairs of the configuration, or by a sweep's name.

`find` lists run folders, and `read` loads the records of one.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Final

import yaml

from islandgp.errors import RunError, StudyError, brief
from islandgp.gp.record import Champion, Cost
from islandgp.plain import DECODE_ERRORS, from_plain
from islandgp.records.folder import RunFolder, is_copy
from islandgp.records.parameters import ending_in_digest, flatten
from islandgp.study.arms import Arm, Run
from islandgp.sweep.folder import SweepFile, SweepFolder


@dataclass(frozen=True, slots=True)
class RunEntry:
    """A run's folder before its records are read."""

    path: Path
    config: Mapping[str, Any]
    flat: Mapping[str, Any]
    finished: bool


def find(folder: Path) -> list[RunEntry]:
    """All run folders in a folder, sorted by path, without MLflow's copies of runs.

    Raises:
        StudyError: there is no such folder.
        RunError: a run's configuration is damaged.
    """
    if not folder.is_dir():
        raise StudyError(
            f"Expected runs in {folder}, found no such folder; run `python -m islandgp` first,"
            " or set --runs FOLDER."
        )
    runs = []
    for file in sorted(folder.rglob("config.yaml")):
        if not (file.parent / "generations.jsonl").exists() or is_copy(file.parent, folder):
            continue
        run = RunFolder(file.parent)
        config = run.configuration()
        if {"domain", "seed", "name", "supervisor"} <= set(config):
            runs.append(RunEntry(file.parent, config, flatten(config), run.finished()))
    return runs


def read(entry: RunEntry) -> Run:
    """A finished run with all its records.

    Raises:
        StudyError: its files are damaged, or come from another version.
    """
    folder = RunFolder(entry.path)
    try:
        champion = folder.summary()["champion"]
        champion["record"] |= {"tree": champion["tree"]}  # shortened
        validation = champion["validation"] or {"worlds": (), "mean": None}
        run = Run(
            path=entry.path,
            config=entry.config,
            flat=entry.flat,
            records=tuple(folder.generations()),
            costs=tuple(from_plain(Cost, plain) for plain in folder.costs()),
            champion=from_plain(Champion, champion),
            validation=(*champion["chosen_in"], *validation["worlds"]),
            validation_mean=validation["mean"],
            feasible=validation.get("feasible"),
        )
    except RunError as error:
        raise StudyError(str(error)) from error
    except (OSError, *DECODE_ERRORS) as error:
        raise StudyError(
            f"Expected a finished run's records in {entry.path}, found {type(error).__name__}:"
            f" {brief(error)}. They are damaged or from another version: run it again."
        ) from error
    if not run.records or len(run.costs) != len(run.records):
        raise StudyError(
            f"Expected as many costs as generations in {entry.path}, found {len(run.costs)} and"
            f" {len(run.records)}; run it again."
        )
    return run


SHORT_KEYS: Final = {
    "supervisor": "supervisor.name",
    "search": "search.name",
    "evaluator": "evaluator.factory",
}
"""Short names in selections, with the keys of the configuration."""

UNSUPERVISED: Final = "baseline"
"""The supervisor that does not guide the search; its arms are compared with all others."""

MAX_NAME: Final = 80
"""Most characters of an arm's name: files of a report have the names of two arms."""

_RANGE = re.compile(r"range\((\d+)(?:,\s*(\d+))?\)")
_PART = re.compile(r"""(?:\([^)]*\)|\[[^]]*\]|'[^']*'|"[^"]*"|\S)+""")
"""A part of a selection; it may contain spaces in brackets and quotes."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Settings that an arm's runs have in common, by dotted key."""

    text: str
    conditions: tuple[tuple[str, Any], ...]  # a key, and a value or a range of values

    @property
    def keys(self) -> frozenset[str]:
        """The selected keys."""
        return frozenset(key for key, _ in self.conditions)


def parse_arm(text: str) -> tuple[str, str]:
    """`expert=supervisor=expert` as ("expert", "supervisor=expert"). Raises StudyError."""
    name, _, selection = text.partition("=")
    if len(name.strip()) > MAX_NAME:
        raise StudyError(
            f"Expected an arm's name of at most {MAX_NAME} characters, found {len(name.strip())}:"
            f" {name.strip():.20}...; files of the report have these names."
        )
    if not re.fullmatch(r"\w[\w.+-]*", name.strip()) or not selection.strip():
        raise StudyError(
            f'Expected --arm NAME="KEY=VALUE ...", found {text!r};'
            ' for instance --arm expert="supervisor=expert".'
        )
    return name.strip(), selection.strip()


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


def matches(run: RunEntry, selection: Selection) -> bool:
    """True if a run matches a selection."""
    return all(
        key in run.flat
        and (run.flat[key] in value if isinstance(value, range) else _equal(run.flat[key], value))
        for key, value in selection.conditions
    )


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


def select(name: str, text: str, runs: Sequence[RunEntry]) -> tuple[Arm, tuple[str, ...]]:
    """The arm of the finished runs that match, and notes on those that are left out.

    Raises:
        StudyError: no run matches; the message lists the existing runs.
    """
    selection = parse_selection(text)
    fitting = [run for run in runs if matches(run, selection)]
    if not any(run.finished for run in fitting):
        raise StudyError(_nothing(name, selection, runs, len(fitting)))
    return _arm(name, text, fitting, selection.keys)


def arms_of_sweep(runs: Sequence[RunEntry]) -> tuple[list[Arm], list[str]]:
    """The arms of a sweep, with notes on omitted runs.

    An arm has the runs that differ only in their seed; its name is that of its supervisor, with the
    settings that differ between arms. Arms without a supervisor (`baseline`) are the last.

    Raises:
        StudyError: the runs are of several sweeps, or have fewer than two arms with finished runs.
    """
    if len(names := sorted({str(run.flat["name"]) for run in runs})) > 1:
        raise StudyError(
            f"Expected --name or --arm, as there are runs of {len(names)} sweeps, found neither.\n"
            "There are:\n  " + "\n  ".join(overview(runs))
        )
    files = {folder: SweepFolder(folder).read() for folder in {run.path.parent for run in runs}}
    keys = frozenset[str]().union(*(file.studied_keys() for file in files.values() if file))
    members, notes = _by_arm(runs, files)
    finished = {label: group for label, group in members.items() if any(r.finished for r in group)}
    if len(finished) < 2:
        unfinished = sum(not run.finished for group in members.values() for run in group)
        more = f" (unfinished runs: {unfinished})" if unfinished else ""
        raise StudyError(
            f"Expected two arms or more with finished runs, found {', '.join(finished) or 'none'}"
            f"{more}; run a sweep such as supervisor=baseline,expert, or select arms by --arm."
        )
    ordered = sorted(finished.items(), key=lambda each: each[0].startswith(UNSUPERVISED))
    arms: list[Arm] = []
    for label, group in ordered:
        name = base = _arm_name(label)
        number = 2
        while name in {arm.name for arm in arms}:
            name, number = f"{base}-{number}", number + 1
        arm, remarks = _arm(name, f"supervisor={label}", group, keys)
        arms.append(arm)
        notes += remarks
    return arms, notes


def _arm_name(label: str) -> str:
    """The supervisor and overrides as an arm's name; a long one is cut, and ends in a digest."""
    name = re.sub(r"[^\w.+-]+", "-", label).strip("-")
    return name if len(name) <= MAX_NAME else ending_in_digest(name, label, MAX_NAME)


def _by_arm(
    runs: Sequence[RunEntry], files: Mapping[Path, SweepFile | None]
) -> tuple[dict[str, list[RunEntry]], list[str]]:
    """The runs by arm, and a note on those that are beside a sweep's runs, but none of its jobs.

    Args:
        runs: of one sweep, or single runs of one name.
        files: sweep.json by folder; None for a folder with single runs only.
    """
    members: dict[str, list[RunEntry]] = defaultdict(list)
    others: list[str] = []
    jobs = {
        folder / job.folder: file.arm(job)
        for folder, file in files.items()
        if file is not None
        for job in file.jobs
    }
    for run in runs:
        if files[run.path.parent] is None:
            members[str(run.flat["supervisor.name"])].append(run)
        elif run.path in jobs:
            label = jobs[run.path].replace(" +", " ")  # `+` is Hydra's mark of an added key
            members[label].append(run)
        else:
            others.append(run.path.name)
    if not others:
        return members, []
    return members, [
        f"{len(others)} runs that are not jobs of the sweep are left out ({', '.join(others[:3])}"
        f"{', ...' * (len(others) > 3)}); --arm selects any run."
    ]


def _arm(
    name: str, text: str, runs: Sequence[RunEntry], keys: frozenset[str]
) -> tuple[Arm, tuple[str, ...]]:
    """The arm of the finished ones of these runs, and notes on the others."""
    selected = sorted((read(r) for r in runs if r.finished), key=lambda r: (r.seed, str(r.path)))
    notes: tuple[str, ...] = ()
    if left_out := [r.path.name for r in runs if not r.finished]:
        notes = (
            f"{name}: {len(left_out)} unfinished runs are left out ({', '.join(left_out[:3])}"
            f"{', ...' * (len(left_out) > 3)}); the command that started them finishes them.",
        )
    return Arm(name, text, tuple(selected), keys), notes


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
    keys = sorted({key for run in runs for key in run.flat})
    hints = []
    for key in sorted(selection.keys - set(keys)):
        near = get_close_matches(key, [*keys, *SHORT_KEYS], 1, 0.5)
        hints.append(f" There is no key {key}{f', did you mean {near[0]}?' if near else '.'}")
    if SHORT_KEYS.get(name, name) in keys:  # the arm's own name was forgotten
        hints.append(f' Did you mean --arm NAME="{name}={selection.text}"?')
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
