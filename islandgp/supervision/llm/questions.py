"""The questions of a generation for a rate, a tree and edits: prompt, answer model and check."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from pydantic import BaseModel

from islandgp.bt.core.kinds import KINDS
from islandgp.bt.core.node import Limits
from islandgp.bt.export.grammar import answer_grammar, tree_grammar
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
    NO_VALUES,
    RUN_VALUES,
    RunHistory,
    RunValues,
    constant_values,
    edit_values,
    known_texts,
    run_values,
)
from islandgp.supervision.llm.message import Request, ServerCapabilities
from islandgp.supervision.llm.prompts import (
    fixed_edit_values,
    fixed_values,
    load_prompt,
    progress,
    prompt_folder,
    render,
    run_facts,
    urgency,
)
from islandgp.supervision.llm.settings import LLMSettings, TreeSize
from islandgp.supervision.state_json import state_text

MAX_CHILDREN: Final = 3  # of a composite in a tree that is decoded by a grammar
NEAR: Final = 1.2  # factor on the shortest cached length, as tokens are only estimated
_PROMPTS: Final = {
    "rate": ("mutation_rate",),
    "tree": ("tree_explore", "tree_exploit"),
    "edits": ("edits",),
}
_PER_GENERATION: Final = (  # known only in a generation
    "generation", "state", "urgency", "progress", "answer", "stage", "error",
    *RUN_VALUES, *EDIT_VALUES
)  # fmt: skip


class Questions:
    """Makes the requests for the parts of the guidance, and the checks of their answers."""

    def __init__(self, settings: LLMSettings, context: RunContext) -> None:
        """Reads the prompts.

        Raises:
            SupervisionError: a prompt has an unknown variable, or no part of the guidance is used.
        """
        self.settings, self.context = settings, context
        if not self.parts:
            raise SupervisionError(
                "Expected a search that uses rates, trees or edits, and a supervisor with"
                " one of them switched on, found nothing to ask the model for; set search=paper,"
                " supervisor.inject=true or supervisor.edits=2, or take supervisor=baseline."
            )
        self.exploit_from = settings.exploit_from or context.classes.milestones[-1]
        if self.exploit_from not in context.classes.milestones:
            raise SupervisionError(
                "supervisor.policy.exploit_from: expected one of classes.milestones"
                f" ({', '.join(context.classes.milestones)}), found {self.exploit_from!r}"
            )
        folder = prompt_folder(settings.prompts)
        files = (*_PROMPTS["rate"], *_PROMPTS["tree"], "repair")
        self.prompts = {name: load_prompt(name, folder) for name in files}
        self.values = {
            **fixed_values(context),
            **run_facts(context),
            **settings.rate_values,
            **constant_values(settings.informed, context),
        }
        self._order: Callable[[dict[str, Any]], dict[str, Any]] = (
            reasons_first if settings.informed.reasoning else dict
        )
        if context.edits:
            edits_folder = folder if (folder / "edits.md").is_file() else prompt_folder("paper")
            self.prompts["edits"] = load_prompt("edits", edits_folder)
            self.values |= fixed_edit_values(context)
            self.values["edit_answer"] = form(self._order(schema(EditsAnswer)))
        prompts = {name for part in self.parts for name in _PROMPTS[part]}
        used = {v for name in prompts for v in self.prompts[name].variables}
        self.uses_history = bool(used.intersection(RUN_VALUES))
        self.history = RunHistory()
        named = context.library().trees if context.edits or settings.refuse_copies else {}
        self._examples = tuple(named.values())
        self._last: tuple[PopulationState, RunValues] | None = None
        self._blank = {
            **self.values,
            **settings.explore.values,
            **dict.fromkeys(_PER_GENERATION, ""),
        }
        for prompt in self.prompts.values():
            render(prompt, self._blank)

    @property
    def parts(self) -> list[str]:
        """The parts of the guidance that the model is asked for in each generation."""
        used = {
            "rate": self.context.adapt_mutation,
            "tree": self.context.inject,
            "edits": self.context.edits,
        }
        return [part for part, is_used in used.items() if is_used]

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`. Keeps the history, if prompts or checks use it."""
        if self.uses_history or self.settings.refuse_copies or self.context.edits:
            self.history = self.history.followed_by(generation)

    def requests(
        self, state: PopulationState, capabilities: ServerCapabilities
    ) -> dict[str, Request]:
        """The requests for all parts of the guidance."""
        return {part: self.request(part, state, capabilities) for part in self.parts}

    def request(
        self, part: str, state: PopulationState, capabilities: ServerCapabilities
    ) -> Request:
        """The request for a part."""
        settings = self.settings
        phase, size = self._tree_phase(state)
        name = {"rate": "mutation_rate", "tree": phase, "edits": "edits"}[part]
        answer: type[BaseModel] = EditsAnswer if part == "edits" else DecisionAnswer
        if part == "tree":
            answer = proposal_model(state.targets)
        shape = self._order(schema(answer))
        by_grammar = capabilities.grammar and part != "edits"  # those have a schema
        structured = capabilities.structured or (capabilities.grammar and not by_grammar)
        system, user = render(
            self.prompts[name],
            {
                **self.values,
                **size.values,
                "generation": str(state.now.generation),
                "state": state_text(state, self.context.crisis),
                "urgency": urgency(state, settings.rare),
                "progress": progress(state),
                "answer": form(shape),
                **self.run_values(state).values,
            },
        )
        return Request(
            model=settings.model_name,
            system=system,
            turns=(user,),
            max_tokens=settings.reply_tokens,
            temperature=capabilities.temperature,
            schema=shape if structured else None,
            cache=settings.cache,
            thinking=settings.thinking_value,
            effort=settings.effort,
            extra=settings.extra_body,
            grammar=self._grammar(shape, size) if by_grammar else None,
        )

    def _grammar(self, shape: Mapping[str, Any], size: TreeSize) -> str:
        """The grammar of an answer; of a tree with the requested depth."""
        tree = tree_grammar(
            self.context.schema.vocabulary,
            min(size.depth, self.context.limits.max_depth),
            kinds=[name for name, kind in KINDS.items() if kind.paper],
            children=MAX_CHILDREN,
            in_json=True,
        )
        rate = self.settings.rate
        return answer_grammar(shape, tree, (rate.least, rate.most)).text("gbnf")

    def check(self, part: str, state: PopulationState) -> Check:
        """The check of the answers for a part."""
        settings, limits = self.settings, self.context.limits
        vocabulary = self.context.schema.vocabulary
        now = self.history.now
        living = {} if now is None else nameable([now.individuals], now.archive)
        existing = known_texts(living.values(), self._examples)
        if part == "rate":
            return partial(check_decision, rates=settings.rate)
        if part == "tree":
            size = self._tree_phase(state)[1]
            return partial(
                check_proposal,
                limits=Limits(
                    min(size.most_depth, limits.max_depth), min(size.most_nodes, limits.max_nodes)
                ),
                vocabulary=vocabulary,
                targets=state.targets,
                existing=existing if settings.refuse_copies else None,
            )
        return partial(
            check_edits, living=living, existing=existing, vocabulary=vocabulary, limits=limits
        )

    def repair(self, rejection: Rejection) -> str:
        """The text of the turn that quotes the error of a rejected answer."""
        values = {"stage": rejection.stage.value, "error": rejection.error}
        return render(self.prompts["repair"], {**self.values, **values})[1]

    def run_values(self, state: PopulationState) -> RunValues:
        """The prompts' values on the run so far; computed once per generation."""
        if self._last is None or self._last[0] is not state:
            result = NO_VALUES
            if self.uses_history:
                result = run_values(self.settings.informed, self.context, state, self.history)
            if self.context.edits:
                values, played = edit_values(self.context, self.history, self.settings.parents)
                result = RunValues({**result.values, **values}, result.episodes + played)
            self._last = (state, result)
        return self._last[1]

    def too_short(self) -> str:
        """A line on first system prompts that the model's cache does not take; "" for none."""
        settings, facts = self.settings, self.settings.facts
        if not settings.cache or facts.caches_from is None:
            return ""
        systems = {p: render(self.prompts[_PROMPTS[p][0]], self._blank)[0] for p in self.parts}
        tokens = {part: round(len(text) / facts.characters, -2) for part, text in systems.items()}
        short = [f"{n} (about {t:,.0f})" for n, t in tokens.items() if t < NEAR * facts.caches_from]
        if not short:
            return ""
        return (
            f"cache=true: {settings.model_name} caches prompts of at least {facts.caches_from:,}"
            f" tokens; too short or nearly too short: {', '.join(short)}"
        )

    def _tree_phase(self, state: PopulationState) -> tuple[str, TreeSize]:
        """Section 2.4.6: exploration until the milestone `exploit_from`, then exploitation."""
        if state.milestones_reached[self.exploit_from]:
            return "tree_exploit", self.settings.exploit
        return "tree_explore", self.settings.explore
