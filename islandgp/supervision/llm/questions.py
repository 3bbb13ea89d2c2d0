"""The questions of a generation for a rate, a tree and edits: prompt, answer model and check."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from pydantic import BaseModel

from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.export.grammar import answer_grammar, edit_grammar, tree_grammar
from islandgp.errors import SupervisionError
from islandgp.scoring.state import PopulationState
from islandgp.supervision.base import GenerationView, RunContext
from islandgp.supervision.guidance import nameable
from islandgp.supervision.llm.answers import (
    Check,
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
from islandgp.supervision.llm.history import EDIT_VALUES, RUN_VALUES, listing, parents_of, sections
from islandgp.supervision.llm.message import Request
from islandgp.supervision.llm.prompts import fixed_values, load_prompt
from islandgp.supervision.llm.settings import LLMSettings
from islandgp.supervision.state_json import OF_RATES, OF_STAGES, state_text

MAX_CHILDREN: Final = 3  # of a composite in a tree that is decoded by a grammar
PROMPTS: Final = {"rate": "mutation_rate", "tree": "tree", "edits": "edits"}
"""Files of prompts by the part of the guidance."""
LATER: Final = ("generation", "state", "urgency", "progress", "answer", *RUN_VALUES, *EDIT_VALUES)
"""Variables that are known in a generation only."""
IN_REPAIRS: Final = ("stage", "error")


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
        # The paper's prompts leave out what the run teaches.
        self.informed = settings.prompts != "paper"
        rates = () if context.by_rate else OF_RATES
        self._library = context.library()
        fixed = fixed_values(context, self._library)
        self._examples = [fixed.pop(f"{phase}_examples") for phase in ("explore", "exploit")]
        self._without = (*rates, *(() if fixed["staged"] else OF_STAGES))
        self.values = {
            **dict.fromkeys((*LATER, *IN_REPAIRS), ""),
            **fixed,
            "rate": settings.rate_words,
            "informed": self.informed,
        }
        self.history: list[GenerationView] = []  # the generations so far
        self.traced = True  # prompts have descriptions of episodes
        self.evidence: GenerationView | None = None
        """The generation whose points and episodes the question for edits shows; None: its own."""
        self.episodes: dict[str, int] = {}  # simulated for the last request, by part
        names = (*(PROMPTS[part] for part in self.parts), "repair")
        self.prompts = {name: load_prompt(name, settings.prompts) for name in names}
        known = self.values | self._of_phase(exploit=False)
        self.variables = {name: p.variables(known) for name, p in self.prompts.items()}
        for prompt in self.prompts.values():
            prompt.render(known)

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`."""
        self.history.append(generation)

    def request(self, part: str, state: PopulationState | None = None) -> Request:
        """The request for a part; without a state it lacks the values of LATER."""
        settings, shape, exploit = self.settings, {}, False
        values = self.values
        if state is not None:
            exploit = state.milestones_reached[self.context.classes.milestones[-1]]
            shape = self._shape(part, state)
            values = values | {"answer": form(shape)} | self._of_generation(part, state)
        values = values | self._of_phase(exploit=exploit)
        system, user = self.prompts[PROMPTS[part]].render(values)
        has_grammar = settings.sends_grammar and state is not None
        return Request(
            model=settings.model_name,
            system=system,
            turns=(user,),
            max_tokens=settings.reply_tokens,
            temperature=settings.temperature,
            schema=shape if settings.sends_schema else None,
            grammar=self._grammar(part, shape, values["depth"]) if has_grammar else None,
        )

    def _shape(self, part: str, state: PopulationState) -> dict[str, Any]:
        """The JSON schema of the answer for a part."""
        answer: type[BaseModel] = EditsAnswer if part == "edits" else DecisionAnswer
        if part == "tree":
            answer = proposal_model(state.targets)
        return reasons_first(schema(answer)) if self.informed else schema(answer)

    def _of_phase(self, *, exploit: bool) -> dict[str, Any]:
        """Section 2.4.6: exploration until the last milestone, then exploitation."""
        size = self.settings.exploit if exploit else self.settings.explore
        return {
            "explore": not exploit,
            "exploit": exploit,
            "depth": min(size.depth, self.context.limits.max_depth),
            "nodes": size.nodes,
            "examples": self._examples[exploit],
        }

    def _of_generation(self, part: str, state: PopulationState) -> dict[str, Any]:
        """The values of LATER. Episodes are simulated for some of them."""
        names = self.variables[PROMPTS[part]] - {*(() if self.informed else RUN_VALUES)}
        values, self.episodes[part] = sections(
            *(self.context, self.history, state, names),
            rare=self.settings.rare,
            count=self.settings.parents,
            evidence=self.evidence,
            traced=self.traced,
        )
        text = state_text(state, self._without)
        return {"generation": state.now.generation, "state": text, **values}

    def _grammar(self, part: str, shape: Mapping[str, Any], depth: int) -> str:
        """The grammar of an answer; of a tree of this depth, or a branch of half."""
        tree = tree_grammar(
            self.context.schema.vocabulary,
            max(2, depth // 2) if part == "edits" else depth,
            kinds=[name for name, kind in KINDS.items() if kind.paper],
            children=MAX_CHILDREN,
            in_json=True,
        )
        if part == "edits" and self.history:
            parents = parents_of(self.history[-1], self.context, self.settings.parents)
            vocabulary = self.context.schema.vocabulary
            places = {i.id: [*listing(parse(i.tree, vocabulary))] for i in parents}
            return edit_grammar(tree, places).text("gbnf")
        return answer_grammar(shape, tree, self.settings.rates).text("gbnf")

    def check(self, part: str, state: PopulationState) -> Check:
        """The check of the answers for a part."""
        if part == "rate":
            return partial(check_decision, rates=self.settings.rates)
        bounds = (self.context.limits, self.context.schema.vocabulary)
        if part == "tree":
            return lambda reply: check_proposal(reply, *bounds, state.targets)
        living: dict[str, str] = {}
        for now in self.history[-1:]:
            living = nameable(now.individuals, now.archive)
        existing = frozenset((*living.values(), *map(to_text, self._library.trees.values())))
        return lambda reply: check_edits(reply, *bounds, living, existing)

    def repair(self, rejection: Rejection) -> str:
        """The text of the turn that quotes the error of a rejected answer."""
        values = {"stage": rejection.stage.value, "error": rejection.error}
        return self.prompts["repair"].render({**self.values, **values})[1]
