"""The questions of a generation for a rate, a tree and edits: prompt, answer model and check."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from pydantic import BaseModel

from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import to_text
from islandgp.bt.export.grammar import answer_grammar, edit_grammar, tree_grammar
from islandgp.errors import SupervisionError
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.guidance import nameable
from islandgp.supervision.llm.answers import (
    DecisionAnswer,
    EditsAnswer,
    Rejection,
    check_decision,
    check_edits,
    check_proposal,
    form,
    proposal_model,
    reasons_first,
    schema,
)
from islandgp.supervision.llm.calls import Check
from islandgp.supervision.llm.history import (
    EDIT_VALUES,
    RUN_VALUES,
    RunHistory,
    Sections,
    parents_of,
    paths_of,
)
from islandgp.supervision.llm.message import Request
from islandgp.supervision.llm.prompts import (
    examples,
    fixed_values,
    load_prompt,
    stages_differ_by,
)
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.state_json import OF_RATES, OF_STAGES, state_text
from islandgp.text import in_points

MAX_CHILDREN: Final = 3  # of a composite in a tree that is decoded by a grammar
PROMPTS: Final = {"rate": "mutation_rate", "tree": "tree", "edits": "edits"}
"""Files of prompts by the part of the guidance."""


class Questions:
    """Makes the requests for the parts of the guidance, and the checks of their answers."""

    def __init__(self, settings: LLMSettings, context: RunContext) -> None:
        """Reads the prompts.

        Raises:
            SupervisionError: a prompt has an unknown variable, or no part of the guidance is used.
        """
        self.settings, self.context = settings, context
        used = {"rate": context.adapt_mutation, "tree": context.inject, "edits": context.edits}
        self.parts = [part for part, is_used in used.items() if is_used]
        if not self.parts:
            raise SupervisionError(
                "Expected a search that uses rates, trees or edits, and a supervisor with"
                " one of them switched on, found nothing to ask the model for; set search=paper,"
                " supervisor.inject=true or supervisor.edits=2, or take supervisor=baseline."
            )
        self.prompts = {
            name: load_prompt(name, settings.prompts)
            for name in (*(PROMPTS[part] for part in self.parts), "repair")
        }
        # The paper's prompts leave out what the run teaches.
        self.informed = settings.prompts != "paper"
        rates = () if context.by_rate else OF_RATES
        self._without = (*rates, *(() if stages_differ_by(context) else OF_STAGES))
        self.values = {
            **fixed_values(context),
            "rate": settings.rate_words,
            "informed": self.informed,
        }
        self.history = RunHistory()
        self._library = context.library()
        self.traced = True  # prompts have descriptions of episodes
        self.evidence: GenerationView | None = None
        """The generation whose points and episodes the question for edits shows; None: its own."""
        self._last: tuple[PopulationState | None, dict[str, tuple[dict[str, str], int]]] = (
            None,
            {},
        )
        self.blank_requests()

    def blank_requests(self) -> dict[str, Request]:
        """The requests for all parts, without what is known in a generation only.

        Raises SupervisionError if a prompt has an unknown variable.
        """
        names = ("generation", "state", "urgency", "progress", "answer", "stage", "error")
        blank = dict.fromkeys((*names, *RUN_VALUES, *EDIT_VALUES), "")
        values = {**self.values, **self._of_phase(exploit=False), **blank}
        self.variables = {n: prompt.variables(values) for n, prompt in self.prompts.items()}
        texts = {name: prompt.render(values) for name, prompt in self.prompts.items()}
        return {
            part: Request(
                self.settings.model_name,
                texts[PROMPTS[part]][0],
                (texts[PROMPTS[part]][1],),
                self.settings.reply_tokens,
                cache=self.settings.cache,
            )
            for part in self.parts
        }

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.history = self.history.followed_by(generation)

    def request(self, part: str, state: PopulationState) -> Request:
        """The request for a part."""
        settings = self.settings
        exploit = state.milestones_reached[self.context.classes.milestones[-1]]
        answer: type[BaseModel] = EditsAnswer if part == "edits" else DecisionAnswer
        if part == "tree":
            answer = proposal_model(state.targets)
        shape = reasons_first(schema(answer)) if self.informed else schema(answer)
        values = {
            **self.values,
            **self._of_phase(exploit=exploit),
            "generation": str(state.now.generation),
            "state": state_text(state, self.context.crisis, self._without),
            "urgency": self._urgency(state),
            "progress": progress(state),
            "answer": form(shape),
            **self._run_values(part, state)[0],
        }
        system, user = self.prompts[PROMPTS[part]].render(values)
        return Request(
            model=settings.model_name,
            system=system,
            turns=(user,),
            max_tokens=settings.reply_tokens,
            temperature=settings.temperature,
            schema=shape if settings.sends_schema else None,
            cache=settings.cache,
            extra=settings.extra_body,
            grammar=self._grammar(part, shape, exploit=exploit) if settings.sends_grammar else None,
        )

    def _of_phase(self, *, exploit: bool) -> dict[str, str]:
        """Section 2.4.6: exploration until the last milestone, then exploitation."""
        phase = "exploit" if exploit else "explore"
        size = self.settings.exploit if exploit else self.settings.explore
        return {
            "explore": "" if exploit else phase,
            "exploit": phase if exploit else "",
            "depth": str(min(size.depth, self.context.limits.max_depth)),
            "nodes": size.nodes,
            "examples": examples(phase, self._library),
        }

    def _urgency(self, state: PopulationState) -> str:
        """The urgency of each behaviour in words, the most urgent first (section 2.4.6)."""
        lines, counters = [], self.context.schema.counters
        for name in state.rarest_behaviours:
            count = state.now.behaviour_counts[name]
            rare = count < self.settings.rare * state.population
            level = "MISSING" if not count else "rare" if rare else "present"
            meaning = counters[self.context.classes.behaviours[name]].meaning
            lines.append(
                f"- {name}: {count} of {state.population} individuals do it: {level} ({meaning})"
            )
        return "\n".join(lines)

    def _grammar(self, part: str, shape: Mapping[str, Any], *, exploit: bool) -> str:
        """The grammar of an answer; of a tree with the requested depth, or a branch of half."""
        size = self.settings.exploit if exploit else self.settings.explore
        depth = min(size.depth, self.context.limits.max_depth)
        tree = tree_grammar(
            self.context.schema.vocabulary,
            max(2, depth // 2) if part == "edits" else depth,
            kinds=[name for name, kind in KINDS.items() if kind.paper],
            children=MAX_CHILDREN,
            in_json=True,
        )
        if part == "edits" and (now := self.history.now) is not None:
            parents = parents_of(now, self.context, self.settings.parents)
            places = {i.id: [*paths_of(i.tree, self.context)] for i in parents}
            return edit_grammar(tree, places).text("gbnf")
        return answer_grammar(shape, tree, self.settings.rates).text("gbnf")

    def check(self, part: str, state: PopulationState) -> Check:
        """The check of the answers for a part."""
        limits, vocabulary = self.context.limits, self.context.schema.vocabulary
        if part == "rate":
            return partial(check_decision, rates=self.settings.rates)
        if part == "tree":
            return partial(
                check_proposal, limits=limits, vocabulary=vocabulary, targets=state.targets
            )
        now = self.history.now
        living = {} if now is None else nameable([now.individuals], now.archive)
        existing = frozenset((*living.values(), *map(to_text, self._library.trees.values())))
        return partial(
            check_edits, living=living, existing=existing, vocabulary=vocabulary, limits=limits
        )

    def repair(self, rejection: Rejection) -> str:
        """The text of the turn that quotes the error of a rejected answer."""
        values = {"stage": rejection.stage.value, "error": rejection.error}
        return self.prompts["repair"].render({**self.values, **values})[1]

    def episodes(self, state: PopulationState) -> int:
        """Episodes simulated for the prompts of a generation."""
        return sum(self._run_values(part, state)[1] for part in self.parts)

    def _run_values(self, part: str, state: PopulationState) -> tuple[dict[str, str], int]:
        """A prompt's values on the run so far, and the episodes simulated for them."""
        if self._last[0] is not state:
            self._last = (state, {})
        of_parts = self._last[1]
        if part not in of_parts:
            names = self.variables[PROMPTS[part]] if self.informed else set()
            names = names if self.traced else names - {"traces"}
            values, episodes = dict.fromkeys((*RUN_VALUES, *EDIT_VALUES), ""), 0
            if (now := self.history.now) is not None:
                sections = Sections(self.context, self.history, self.evidence or now)
                values, episodes = sections.of_run(state.rarest_behaviours, names)
                if part == "edits":
                    parents, traced = self.settings.parents, self.traced
                    more, played = sections.of_edits(now, parents, traced=traced)
                    values, episodes = values | more, episodes + played
            of_parts[part] = values, episodes
        return of_parts[part]


def progress(state: PopulationState) -> str:
    """The generation, and how fitness and diversity have changed in it, in one line."""
    now = state.now
    return (
        f"Generation {now.generation} of {state.generations}: best fitness"
        f" {in_points(now.fitness_max)} ({in_points(state.best_change, '+')}), mean"
        f" {in_points(now.fitness_mean)} ({in_points(state.mean_change, '+')}),"
        f" diversity {now.diversity:.2f}."
    )
