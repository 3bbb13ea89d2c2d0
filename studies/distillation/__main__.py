"""Fit a decision tree to the decisions of past runs: `python -m studies.distillation`.

    python -m studies.distillation RUNS... -o FOLDER [--depth 6] [--cases 4]
        [--config-dir FOLDER]

RUNS are folders with finished runs of one supervisor. States and decisions are read from the
records. FOLDER gets policy.json and rules.txt; `supervisor=distilled` uses the policy.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import islandgp
from islandgp.config.settings import read_settings
from islandgp.errors import StudyError
from islandgp.gate import must_be_known_code, user_folder
from islandgp.gp.record import GuidanceRecord
from islandgp.gp.state import population_state
from islandgp.scoring.state import PopulationState
from studies.distillation.fit import Case, Shape, distil, report_lines
from studies.distillation.policy import NAME, Policy, features, rules

NO_CODE: Final = frozenset({"name", "runs", "start", "resume", "progress"})
"""Top-level keys of a configuration whose values name no code."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Read the runs, fit a policy, write it, and print its agreement with the teacher."""
    parser = argparse.ArgumentParser(prog="python -m studies.distillation", description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path, help="folders with finished runs")
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the policy")
    parser.add_argument("--depth", type=int, default=6, help="maximum depth of a tree, 1 to 20")
    parser.add_argument("--cases", type=int, default=4, help="minimum number of cases of a leaf")
    parser.add_argument("--config-dir", type=Path, help="your folder of configuration")
    options = parser.parse_args(arguments)
    if not (1 <= options.depth <= 20 and options.cases >= 1):
        parser.error("expected --depth from 1 to 20 and --cases of at least 1")
    try:
        policy = fit(options.runs, Shape(options.depth, options.cases), options.config_dir)
        write(policy, options.out)
    except (islandgp.IslandError, OSError) as error:
        parser.exit(2, f"{parser.prog}: {error}\n")
    print(*report_lines(policy), sep="\n")
    print(f"The policy: {options.out / NAME}; in words: {options.out / 'rules.txt'}")


def fit(paths: Sequence[Path], shape: Shape, config_dir: Path | None = None) -> Policy:
    """The policy of all finished runs in these folders. Raises StudyError or RunError."""
    folders = {f.path: f for path in paths for f in islandgp.load(path).folders if f.finished()}
    if not folders:
        raise StudyError(f"Expected finished runs in {', '.join(map(str, paths))}, found none.")
    configurations = [folder.configuration() for folder in folders.values()]
    teachers = sorted({str(config["supervisor"]["name"]) for config in configurations})
    if len(teachers) > 1:
        raise StudyError(
            f"Expected the runs of one supervisor, found those of {', '.join(teachers)};"
            " name the folders of one of them."
        )
    runs = zip(folders, configurations, strict=True)
    cases = [
        case
        for n, (path, config) in enumerate(runs)
        for case in cases_of(n, path, config, config_dir)
    ]
    if len({frozenset(case.known) for case in cases}) > 1:
        raise StudyError(
            "Expected runs whose states have the same fields, found others; give runs with one"
            " domain and the same classes."
        )
    return distil(cases, teachers[0], shape)


def cases_of(
    number: int, path: Path, config: dict[str, Any], config_dir: Path | None
) -> Iterator[Case]:
    """The decisions of a run's supervisor; those of its fallback are left out."""
    for state, guidance in recorded_decisions(path, config, config_dir):
        if guidance.source != "fallback":
            given = {part: not _fell_back(guidance.notes, part) for part in ("tree", "rate")}
            yield Case(
                run=number,
                known=features(state),
                target=guidance.target if guidance.tree is not None and given["tree"] else None,
                rate=guidance.wanted_rate if given["rate"] else None,
            )


def recorded_decisions(
    path: Path, config: dict[str, Any], config_dir: Path | None
) -> Iterator[tuple[PopulationState, GuidanceRecord]]:
    """The states that a run's supervisor was asked about, and its answers.

    Raises:
        RunError: the run is damaged.
        UntrustedError: the run names code that the user's configuration does not name.
    """
    (folder,) = islandgp.load(path).folders
    with user_folder(config_dir):
        must_be_known_code({key: v for key, v in config.items() if key not in NO_CODE})
    settings = read_settings(config)
    plan = settings.plan(settings.make_domain())
    records = list(folder.generations())
    history = [record.snapshot for record in records]
    for record in records:
        guidance = record.guidance
        if guidance is not None and guidance.asked_at is not None:
            yield population_state(plan, history[: guidance.asked_at + 1]), guidance


def _fell_back(notes: dict[str, Any], part: str) -> bool:
    return str(notes.get(part, "")).startswith("fallback")


def write(policy: Policy, folder: Path) -> None:
    """Write the policy as JSON and in words. Raises OSError."""
    lines = ["The target:", *rules(policy.target), "", "The rate:", *rules(policy.rate)]
    folder.mkdir(parents=True, exist_ok=True)
    (folder / NAME).write_text(policy.model_dump_json(indent=1) + "\n", encoding="utf-8")
    (folder / "rules.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
