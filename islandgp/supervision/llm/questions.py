"""The questions of a generation: for a rate, a tree and edits, each with prompt, model and check.

A part of the guidance is "rate", "tree", "edits", or a further sample of these such as "edits 2".
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from pydantic import BaseModel

from islandgp.bt.core.node import Limits
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
    prompt_folder,
    render,
    run_facts,
    urgency,
)
from islandgp.supervision.llm.settings import LLMSettings, TreeSize
from islandgp.supervision.state_json import state_text

NO_MODELS: Final[Mapping[str, str]] = {}
NEAR: Final = 1.2  # factor on the shortest cached length, as tokens are only estimated
_PROMPTS: Final = {
    "rate": ("mutation_rate",),
    "tree": ("tree_explore", "tree_exploit"),
    "edits": ("edits",),
}
_PER_GENERATION: Final = (  # known only in a generation
    "generation", "state", "urgency", "answer", "tree_field", "stage", "error",
    *RUN_VALUES, *EDIT_VALUES
)  # fmt: skip
_TREE_FIELD: Final = "- tree: the tree in the language, as one JSON string; write line ends as \\n."
_TREES_FIELD: Final = (
    "- trees: {} trees for the same target, each another idea, as JSON strings in the language;"
    " write\n  line ends as \\n. Each is tried in one episode, and the best joins the population."
)
_SHARED: Final = (
    "You are asked {} kinds of questions: {}. The first line of each message names its question."
    " Answer it by the instructions under its heading; those of other questions do not apply."
)


def kind_of(part: str) -> str:
    """The question of a part: `edits 2` is the second answer to `edits`."""
    return part.partition(" ")[0]


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
            edits_folder = folder if (folder / "edits.md").is_file() else prompt_folder(None)
            self.prompts["edits"] = load_prompt("edits", edits_folder)
            self.values |= fixed_edit_values(context)
            self.values["edit_answer"] = form(self._order(schema(EditsAnswer)))
        prompts = {name for part in self.parts for name in _PROMPTS[kind_of(part)]}
        used = {v for name in prompts for v in self.prompts[name].variables}
        if settings.candidates > 1 and context.inject and not {"answer", "tree_field"} <= used:
            raise SupervisionError(
                "Expected {{answer}} and {{tree_field}} in the prompts for trees in"
                f" {folder}, as supervisor.policy.candidates={settings.candidates} needs them,"
                " found none; add them, or set candidates=1."
            )
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
        samples = range(1, self.settings.samples + 1) if self.context.edits else ()
        return [
            *["rate"] * self.context.adapt_mutation,
            *["tree"] * self.context.inject,
            *(f"edits {k}" if k > 1 else "edits" for k in samples),
        ]

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`. Keeps the history, if prompts or checks use it."""
        if self.uses_history or self.settings.refuse_copies or self.context.edits:
            self.history = self.history.followed_by(generation)

    def requests(
        self,
        state: PopulationState,
        capabilities: ServerCapabilities,
        models: Mapping[str, str] = NO_MODELS,
    ) -> dict[str, Request]:
        """The requests for all parts of the guidance, to `models`, or the settings' model."""
        requests = {
            part: self.request(part, state, capabilities, models.get(part)) for part in self.parts
        }
        return shared_prompts(requests, self.settings)

    def request(
        self,
        part: str,
        state: PopulationState,
        capabilities: ServerCapabilities,
        model: str | None = None,
    ) -> Request:
        """The request for a part alone; model=None: the settings'."""
        settings, kind = self.settings, kind_of(part)
        phase, size = self._tree_phase(state)
        name = {"rate": "mutation_rate", "tree": phase, "edits": "edits"}[kind]
        answer: type[BaseModel] = EditsAnswer if kind == "edits" else DecisionAnswer
        if kind == "tree":
            answer = proposal_model(state.targets, settings.candidates)
        shape = self._order(schema(answer))
        has_list = "trees" in shape["properties"]
        system, user = render(
            self.prompts[name],
            {
                **self.values,
                **size.values,
                "generation": str(state.now.generation),
                "state": state_text(state, self.context.crisis),
                "urgency": urgency(state, settings.rare),
                "answer": form(shape),
                "tree_field": _TREES_FIELD.format(settings.candidates) if has_list else _TREE_FIELD,
                **self.run_values(state).values,
            },
        )
        return Request(
            model=model or settings.model_name,
            system=system,
            turns=(user,),
            max_tokens=settings.reply_tokens,
            temperature=capabilities.temperature,
            schema=shape if capabilities.structured else None,
            cache=settings.cache,
            thinking=settings.thinking_value,
            effort=settings.effort,
            extra=settings.extra_body,
        )

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
                candidates=settings.candidates,
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
        settings, facts, requests = self.settings, self.settings.facts, {}
        if not settings.cache or facts.caches_from is None:
            return ""
        for part in self.parts:
            system, user = render(self.prompts[_PROMPTS[kind_of(part)][0]], self._blank)
            requests[part] = Request(settings.model_name, system, (user,), 1)
        shared = shared_prompts(requests, settings)
        tokens = {part: round(len(r.system) / facts.characters, -2) for part, r in shared.items()}
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


def heading(question: str) -> str:
    """The heading of a question in a shared system prompt, and the first line of its messages."""
    return f"# Question: {question}"


def shared_prompts(requests: Mapping[str, Request], settings: LLMSettings) -> dict[str, Request]:
    """Gives requests to the same model one system prompt, if one of theirs is too short to cache.

    A server caches a system prompt from a number of tokens on that depends on the model.

    Args:
        requests: of one generation, by the part of the guidance.
        settings: with `cache`; without it the requests are returned unchanged.
    """
    facts = settings.prices.facts
    shared = dict(requests)
    for model in {request.model for request in requests.values()} if settings.cache else ():
        by_part = {part: r for part, r in requests.items() if r.model == model}
        systems = {kind_of(part): r.system for part, r in by_part.items()}
        shortest = facts[model].caches_from if model in facts else None
        if shortest is None or len(systems) == 1:
            continue
        if min(map(len, systems.values())) >= NEAR * shortest * facts[model].characters:
            continue
        intro = _SHARED.format(len(systems), ", ".join(systems))
        sections = (f"{heading(name)}\n\n{text}" for name, text in systems.items())
        system = "\n\n".join((intro, *sections))
        for part, r in by_part.items():
            turns = (f"{heading(kind_of(part))}\n\n{r.turns[0]}", *r.turns[1:])
            shared[part] = replace(r, system=system, turns=turns)
    return shared


def drawn_models(
    settings: LLMSettings,
    gains: Mapping[str, tuple[int, int]],
    parts: Sequence[str],
    rng: np.random.Generator,
) -> dict[str, str]:
    """Draws a model for each part that asks for edits.

    Args:
        settings: with the weights of the models, and how they are chosen. With choice=bandit by
            Thompson sampling on the share of each model's successful edits.
        gains: numbers of successful and of other edits by model.
        parts: of the guidance.
        rng: the generator is consumed.

    Returns:
        The model by part; {} if only `model` is configured.
    """
    weights = settings.edit_models
    names, total = [*weights], sum(weights.values())
    models = {}
    for part in [part for part in parts if weights and kind_of(part) == "edits"]:
        if settings.choice == "bandit":
            results = [gains.get(name, (0, 0)) for name in names]
            k = int(np.argmax([rng.beta(1 + won, 1 + lost) for won, lost in results]))
        else:
            k = int(rng.choice(len(names), p=[weights[name] / total for name in names]))
        models[part] = names[k]
    return models
