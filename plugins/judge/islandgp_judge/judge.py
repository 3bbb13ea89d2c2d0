"""Judges edits of recorded populations: does a model's judgement help, and does it use the state?

Each arm edits the fittest tree of each population once; it is compared with the edited tree in the
same fresh worlds. The arms `true`, `shuffled` and `blind` ask the same model: with the population's
own points and episodes, with those of another population of the domain, and without episodes. The
others are free: the rules of `supervisor=editor`, a random branch, and a random walk over the
grammar in place of the whole tree.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, replace
from functools import partial
from hashlib import sha256
from math import sqrt
from pathlib import Path
from statistics import fmean, stdev
from typing import Any, Final

import numpy as np
import pandas as pd  # type: ignore[import-untyped]  # its stubs are a package apart

from islandgp.atomic_files import usable, write_atomic
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import Limits, Node, size, within
from islandgp.bt.export.grammar import tree_grammar
from islandgp.config.settings import Settings
from islandgp.errors import RunError
from islandgp.evaluation.base import Job
from islandgp.evaluation.serial import Serial
from islandgp.evolution.generation import evaluate
from islandgp.gp.branches import random_branch, with_branch
from islandgp.gp.edits import Edit, edited
from islandgp.gp.population import Individual, Origin
from islandgp.gp.record import IndividualRecord
from islandgp.gp.state import generation_stats, population_state
from islandgp.plain import DECODE_ERRORS
from islandgp.running.parts import run_context
from islandgp.scoring.state import PopulationState
from islandgp.seeding import Stream, seed_of, stream
from islandgp.statistics import PairedTest, paired_test
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.editor import Editor, EditorSettings
from islandgp.supervision.library import Library
from islandgp.supervision.llm.budget import Bill, answer_tokens
from islandgp.supervision.llm.calls import Calls, converse
from islandgp.supervision.llm.history import parents_of
from islandgp.supervision.llm.message import Client, FailureKind, Request, Usage, sha256_of
from islandgp.supervision.llm.questions import Questions
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.llm.supervisor import probe
from islandgp.supervision.llm.transcript import Call, Start, Transcript
from islandgp.text import in_points
from islandgp_judge.grammar_walk import random_text

POPULATIONS: Final = Path(__file__).with_name("populations.jsonl.gz")
FREE: Final = ("rules", "random", "grammar")
ASKED: Final = ("true", "shuffled", "blind")
WORLDS: Final = 20  # fresh worlds in which a tree and its edited form are compared
LEVEL: Final = 0.05  # of the test of `true` against `shuffled`
WALK: Final = Limits(4, 22)  # of a tree by a grammar walk
RULES: Final = 8  # edits by rules that are tried
TRIES: Final = 50  # random edits until one changes the tree within the limits
QUIET: Final = 1e-9  # scale of a domain whose points never differ


@dataclass(frozen=True, slots=True)
class Population:
    """A recorded population: its records follow from the trees, the world and the configuration."""

    domain: str
    generation: int  # of the run that it comes from
    world: int  # seed of the episode in which it is evaluated
    trees: tuple[str, ...]  # canonical texts


@dataclass(frozen=True, slots=True)
class Case:
    """A population to be judged by."""

    index: int  # in the file
    domain: str
    settings: Settings
    context: RunContext
    view: GenerationView
    state: PopulationState
    parent: IndividualRecord  # the fittest individual


@dataclass(frozen=True, slots=True)
class EditResult:
    """One edit, against the tree before it in the same worlds."""

    arm: str
    population: int
    domain: str
    source: str  # "free", "llm", "llm, repaired", or the reason why there is no usable edit
    before: float  # mean points in WORLDS worlds
    after: float  # the same of the edited tree; `before` without a usable edit
    tree: str  # edited; "" without a usable edit


def read_populations(path: Path) -> list[Population]:
    """The recorded populations. Raises RunError if the file is damaged."""
    try:
        lines = gzip.decompress(path.read_bytes()).decode().splitlines()
        values = [json.loads(line) for line in lines]
        return [Population(**{**v, "trees": tuple(v["trees"])}) for v in values]
    except (*DECODE_ERRORS, OSError, EOFError) as error:
        raise RunError(
            f"Expected recorded populations in {path}, found {type(error).__name__}: {error}."
        ) from None


def chosen(populations: Sequence[Population], number: int, domains: Sequence[str]) -> list[int]:
    """The indices of the first populations in a fixed random order, balanced over the domains."""
    rng = stream(0, Stream.JUDGING)
    by_domain = {d: [k for k, p in enumerate(populations) if p.domain == d] for d in domains}
    for indices in by_domain.values():
        rng.shuffle(indices)
    longest = max(map(len, by_domain.values()), default=0)
    turns = [d[k] for k in range(longest) for d in by_domain.values() if k < len(d)]
    return turns[:number]


def case_of(index: int, p: Population, settings: Settings) -> Case:
    """Evaluates a population in its world.

    `settings` are those of a run in its domain. The library is that of a folder, as a search for
    one would take minutes.
    """
    context = replace(run_context(settings), edits=1, inject=False, adapt_mutation=False)
    if settings.library.folder is None:
        context = replace(context, library=lambda: Library({}, {}, {}, {}))
    gp = settings.gp.model_copy(
        update={"population": max(4, len(p.trees)), "episodes": 1, "shared_seed": True}
    )
    plan = replace(settings.plan(context.domain), gp=gp)
    g, vocabulary = p.generation, context.schema.vocabulary
    individuals = [
        Individual(f"{g}.{k}", parse(t, vocabulary), Origin.COPY) for k, t in enumerate(p.trees)
    ]
    evaluator = Serial(settings.problem())
    evaluated, records, _ = evaluate(plan, g, individuals, [p.world], evaluator)
    stats = generation_stats(plan, g, gp.mutation_rate, evaluated)
    multipliers = plan.curriculum.multipliers(plan.curriculum.stage(g))
    view = GenerationView(stats, (p.world,), multipliers, records, None)
    parent = parents_of(view, context, 1)[0]
    context = replace(context, gp=gp)
    state = population_state(plan, [stats])
    return Case(index, p.domain, settings, context, view, state, parent)


class Worlds:
    """Mean points of trees in the fresh worlds of a case, each tree once."""

    def __init__(self) -> None:
        self._points: dict[tuple[int, str], list[float]] = {}

    def points(self, case: Case, tree: str) -> list[float]:
        """The points of a tree in each world."""
        if (key := (case.index, tree)) not in self._points:
            seeds = [
                seed_of(0, Stream.JUDGING, generation=1 + case.index, slot=k) for k in range(WORLDS)
            ]
            stage = case.settings.curriculum.stage(case.view.snapshot.generation)
            jobs = [Job(tree, stage, seed) for seed in seeds]
            outcomes = Serial(case.settings.problem()).evaluate(jobs)
            self._points[key] = [o.fitness for o in outcomes]
        return self._points[key]

    def result(self, arm: str, case: Case, source: str, tree: Node | None) -> EditResult:
        """The comparison of an edited tree with the tree before."""
        before = fmean(self.points(case, case.parent.tree))
        text = "" if tree is None else to_text(tree)
        after = fmean(self.points(case, text)) if text else before
        return EditResult(arm, case.index, case.domain, source, before, after, text)


def apply(case: Case, edit: Edit) -> Node:
    """The tree of an edit of the population. Raises ValueError if it is not possible."""
    vocabulary = case.context.schema.vocabulary
    trees = {i.id: parse(i.tree, vocabulary) for i in case.view.individuals}
    return edited(edit, trees, vocabulary, case.context.limits)


def by_rules(case: Case, rng: np.random.Generator, settings: EditorSettings) -> Node | None:
    """The first possible edit of `supervisor=editor`; None if it has none."""
    editor = Editor(settings, replace(case.context, edits=RULES))
    editor.on_generation(case.view)
    for _, edit in editor.edits(case.view, rng):
        with suppress(ValueError):
            return apply(case, edit)
    return None


def by_random_branch(case: Case, rng: np.random.Generator) -> Node | None:
    """The tree with a random branch at a random place."""
    space = case.settings.plan(case.context.domain).space
    tree = parse(case.parent.tree, case.context.schema.vocabulary)
    for _ in range(TRIES):
        changed = space.repaired(with_branch(rng, tree, random_branch(rng, space)))
        if changed != tree and within(changed, space.limits):
            return changed
    return None


def by_grammar(case: Case, rng: np.random.Generator) -> Node | None:
    """A random text of the grammar, in place of the whole tree."""
    vocabulary = case.context.schema.vocabulary
    grammar = tree_grammar(vocabulary, WALK.max_depth, children=WALK.max_depth)
    for _ in range(TRIES):
        tree = parse(random_text(grammar, rng), vocabulary)
        if size(tree) > 1 and within(tree, WALK):
            return tree
    return None


@dataclass
class Judge:
    """The cases, and the results of the arms so far."""

    cases: Sequence[Case]
    editor: EditorSettings
    worlds: Worlds = field(default_factory=Worlds)
    results: list[EditResult] = field(default_factory=list)

    def free(self, echo: Callable[[str], None]) -> None:
        """Runs the arms without a model."""
        ways: dict[str, Callable[[Case, np.random.Generator], Node | None]] = {
            "rules": partial(by_rules, settings=self.editor),
            "random": by_random_branch,
            "grammar": by_grammar,
        }
        for k, (arm, way) in enumerate(ways.items()):
            for case in self.cases:
                rng = stream(0, Stream.JUDGING, generation=1 + case.index, slot=WORLDS + k)
                tree = way(case, rng)
                source = "free" if tree is not None else "no edit"
                self.results.append(self.worlds.result(arm, case, source, tree))
            echo(self.line(arm))

    def ask(
        self, policy: LLMSettings, client: Client, folder: Path, echo: Callable[[str], None]
    ) -> None:
        """Asks the model, an arm after the other; answers in the transcripts are used again.

        Raises:
            SupervisionError: the server cannot answer.
        """
        policy = policy.model_copy(update={"on_outage": "stop"})
        for arm in ASKED:
            transcript = Transcript(folder / f"{arm}.jsonl")
            calls = Calls(client, transcript, policy, seed=0)
            if transcript.start is None:
                probe(calls, policy)
                transcript.add(Start({"arm": arm}))
            for case in self.cases:
                self.results.append(self._asked(arm, case, policy, calls))
            echo(self.line(arm))

    def _asked(self, arm: str, case: Case, policy: LLMSettings, calls: Calls) -> EditResult:
        questions, request = self.question(arm, case, policy)
        check = questions.check("edits", case.state)
        call = Call(case.index, "edits", 0)
        guidance, end = converse(calls, questions, call, request, check)
        if guidance is None:
            source = end.failed or (end.rejected[-1] if end.rejected else "fallback")
            return self.worlds.result(arm, case, source, None)
        return self.worlds.result(arm, case, end.source, apply(case, guidance.edits[0]))

    def question(self, arm: str, case: Case, policy: LLMSettings) -> tuple[Questions, Request]:
        """The question of an arm about a case; others differ from `true` in one thing."""
        questions, state = Questions(policy, case.context), case.state
        questions.on_generation(case.view)
        questions.traced = arm != "blind"
        if arm == "shuffled":
            same = [c for c in self.cases if c.domain == case.domain]
            other = same[(same.index(case) + 1) % len(same)]
            questions.evidence, state = other.view, other.state
        return questions, questions.request("edits", state)

    def frame(self, *arms: str) -> pd.DataFrame:
        """The results of arms without those that a cap prevented, with each edit's gain in points.

        `scaled` is the gain in standard deviations of the trees' points between worlds.
        """
        frame = pd.DataFrame(
            map(asdict, self.results), columns=[f.name for f in fields(EditResult)]
        )
        frame = frame[frame.arm.isin(arms) & (frame.source != FailureKind.BUDGET.value)]
        spreads: dict[str, list[float]] = {}
        for case in self.cases:
            points = self.worlds.points(case, case.parent.tree)
            spreads.setdefault(case.domain, []).append(stdev(points))
        scale = frame.domain.map({domain: max(QUIET, fmean(s)) for domain, s in spreads.items()})
        gain = frame.after - frame.before
        return frame.assign(gain=gain, scaled=gain / scale.astype(float))

    def line(self, arm: str) -> str:
        """The row of an arm: edits, usable ones, improved and worse trees, gains by domain."""
        frame = self.frame(arm)
        shares = [(frame.tree != "").mean(), (frame.gain > 0).mean(), (frame.gain < 0).mean()]
        gains = frame.groupby("domain", sort=False).gain.mean().items()
        words = ", ".join(f"{domain} {in_points(gain, '+')}" for domain, gain in gains)
        return f"| {arm} | {len(frame)} | {' | '.join(f'{s:.0%}' for s in shares)} | {words} |"

    def compared(self, first: str, second: str) -> tuple[PairedTest, float]:
        """The paired test of two arms, and the mean difference of the scaled gains."""
        table = self.frame(first, second).pivot(index="population", columns="arm", values="scaled")
        pairs = table.reindex(columns=[first, second]).dropna()
        if pairs.empty:
            return PairedTest(1.0, "no pairs", 0, 0, 0), 0.0
        a, b = (pairs[arm].tolist() for arm in (first, second))
        return paired_test(a, b), float((pairs[first] - pairs[second]).mean())


HEAD: Final = (
    "| arm | edits | usable | improved | worse | mean gain, points |\n|---|---|---|---|---|---|"
)


def shortest_difference(n: int) -> float:
    """The difference of paired means that n pairs detect with probability 80 %, in their SDs."""
    return (1.96 + 0.84) / sqrt(max(1, n))


def plan(judge: Judge, policy: LLMSettings | None) -> tuple[dict[str, Any], Bill]:
    """What will be done and how it is decided, and what one answer to each question costs."""
    asked, bill = {}, Bill(0, 0, 0, 0)
    if policy is not None:
        requests = [judge.question(a, c, policy)[1] for a in ASKED for c in judge.cases]
        digests = [sha256_of([request.system, *request.turns]) for request in requests]
        asked = {"model": policy.model_name, "prompts": sha256_of(digests)}
        characters = sum(len(r.system) + sum(map(len, r.turns)) for r in requests)
        output = len(requests) * answer_tokens(policy)
        usage = Usage(round(characters / policy.facts.characters), output)
        bill = Bill.of(len(requests) + len(ASKED), usage, policy.price)
    n = len(judge.cases)
    content = {
        "populations": [c.index for c in judge.cases],
        "file": sha256(POPULATIONS.read_bytes()).hexdigest(),
        "arms": [*FREE, *(ASKED if asked else ())],
        "worlds": WORLDS,
        **asked,
        "measure": "gain of the edited tree over the tree before, mean of the worlds, in standard"
        " deviations of the trees' points between worlds",
        "test": f"Wilcoxon, paired by population, two-sided, level {LEVEL}: true against shuffled",
        "power": f"80 % for a difference of {shortest_difference(n):.2f} standard deviations",
        "stage 2": "whole runs only if true is above shuffled by this test",
    }
    return content, bill


def verdict(judge: Judge) -> list[str]:
    """The table of the arms and the decision, as Markdown."""
    lines = [HEAD, *(judge.line(arm) for arm in (*FREE, *ASKED) if len(judge.frame(arm))), ""]
    if judge.frame("true").empty:
        return [*lines, "No model was asked: supervisor=llm or local adds its arms."]
    for other in ("shuffled", "blind", "random", "grammar", "rules"):
        test, mean = judge.compared("true", other)
        lines.append(
            f"- true against {other}: {test.higher} higher, {test.lower} lower of {test.pairs};"
            f" mean difference {mean:+.2f} standard deviations; p = {test.p:.2g}"
        )
    test, mean = judge.compared("true", "shuffled")
    helps = test.p < LEVEL and mean > 0
    lines.append(
        "\nThe true state is better than the shuffled one: the model uses it. Stage 2 is worth its"
        " cost: whole runs against yoked and random branches (plugins/judge/README.md)."
        if helps
        else "\nThe true state is not better than the shuffled one at this number of populations:"
        " whole runs (stage 2) are not worth their cost."
    )
    return lines


def write_results(judge: Judge, folder: Path) -> None:
    """Writes `results.csv`, a line for each edit, and `verdict.md`."""
    rows = pd.DataFrame(asdict(r) | {"tree": " ".join(r.tree.split())} for r in judge.results)
    write_atomic(folder / "results.csv", rows.to_csv(index=False, lineterminator="\n").encode())
    write_atomic(folder / "verdict.md", ("\n".join(verdict(judge)) + "\n").encode())


def write_plan(content: dict[str, Any], folder: Path) -> str:
    """Writes `plan.json` and returns its digest.

    Raises:
        RunError: the folder has another plan.
    """
    data = (json.dumps(content, indent=1) + "\n").encode()
    path = folder / "plan.json"
    with usable(folder):
        folder.mkdir(parents=True, exist_ok=True)
        if path.exists() and path.read_bytes() != data:
            raise RunError(
                f"Expected the same plan in {path}, found another one; choose another folder with"
                " -o, or repeat the command that made it."
            )
        write_atomic(path, data)
    return sha256(data).hexdigest()
