"""Makes prompts from a state, and guidance from answers (section 2.4).

The guidance is a function of the state, the settings and the answers, which come from the network
or a transcript. So a replay uses the same code as the recorded run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final, TypeVar

import numpy as np
from pydantic import BaseModel

from islandgp.bt.core.node import Limits
from islandgp.errors import SupervisionError
from islandgp.gp.edits import Edit
from islandgp.plugin import path_of, plugin_errors
from islandgp.scoring.state import PopulationState
from islandgp.supervision.asking import ask
from islandgp.supervision.base import GenerationView, Guidance, RunContext, Supervisor
from islandgp.supervision.llm.answers import (
    DecisionAnswer,
    EditsAnswer,
    Rejection,
    form,
    proposal_model,
    reasons_first,
    schema,
)
from islandgp.supervision.llm.caching import shared_prompts, too_short
from islandgp.supervision.llm.calls import Calls, Conversation, converse, in_thread, unasked
from islandgp.supervision.llm.checks import (
    Check,
    Proposal,
    check_decision,
    check_edits,
    check_proposal,
)
from islandgp.supervision.llm.episode import try_out
from islandgp.supervision.llm.history import (
    EDIT_MODELS,
    EDIT_VALUES,
    NO_VALUES,
    RUN_VALUES,
    RunHistory,
    RunValues,
    edit_values,
    known_texts,
    nameable,
    run_values,
    standing_values,
)
from islandgp.supervision.llm.message import (
    CHARGED,
    Failure,
    FailureKind,
    Request,
    ServerCapabilities,
)
from islandgp.supervision.llm.models import drawn_models, kind_of
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
from islandgp.supervision.llm.transcript import Played
from islandgp.supervision.state_json import state_text

T = TypeVar("T")
NO_MODELS: Final[Mapping[str, str]] = {}
REASON: Final = 600  # most characters of a fallback's reason in the record
_PROMPTS: Final = {
    "rate": ("mutation_rate",),
    "tree": ("tree_explore", "tree_exploit"),
    "edits": ("edits",),
}
FILLS: Final = {
    "rate": tuple(DecisionAnswer.model_fields),
    "tree": ("tree", "target", "rationale"),
    "edits": ("edits",),
}
"""Fields of the guidance that each part's answer sets."""

_PER_GENERATION: Final = (  # known only in a generation
    "generation", "state", "urgency", "answer", "tree_field", "stage", "error",
    *RUN_VALUES, *EDIT_VALUES
)  # fmt: skip
_TREE_FIELD: Final = "- tree: the tree in the language, as one JSON string; write line ends as \\n."
_TREES_FIELD: Final = (
    "- trees: {} trees for the same target, each another idea, as JSON strings in the language;"
    " write\n  line ends as \\n. Each is tried in one episode, and the best joins the population."
)


class Adviser:
    """Asks for a rate, a tree and edits, and combines the answers to a guidance."""

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
        if context.edits:
            has_edits_prompt = (folder / "edits.md").is_file()
            self.prompts["edits"] = load_prompt(
                "edits", folder if has_edits_prompt else prompt_folder(None)
            )
        self.values = {
            **fixed_values(context),
            **run_facts(context),
            **settings.rate_values,
            **standing_values(settings.informed, context),
        }
        self._order: Callable[[dict[str, Any]], dict[str, Any]] = (
            reasons_first if settings.informed.reasoning else dict
        )
        if context.edits:
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
        self._history = RunHistory()
        named = context.library().trees if context.edits or settings.refuse_copies else {}
        self._examples = tuple(named.values())
        self._last: tuple[PopulationState, RunValues] | None = None
        for prompt in self.prompts.values():
            size = settings.explore.values
            render(prompt, {**self.values, **size, **dict.fromkeys(_PER_GENERATION, "")})
        part = settings.fallback
        with plugin_errors(path_of(part.factory)):
            self.fallback: Supervisor = part.factory.make(part.settings(), context)

    def advise(
        self,
        state: PopulationState,
        rng: np.random.Generator,
        calls: Calls,
        capabilities: Callable[[int], ServerCapabilities | Failure],
    ) -> Guidance:
        """Asks for all parts of the guidance; the fallback provides those without a usable answer.

        `rng` is consumed by the choice of models and by the fallback; `capabilities` returns a
        generation's capabilities, or the failure to probe it.

        Raises:
            SupervisionError: too many unusable answers in a row, with `useless.then` "stop".
        """
        generation = state.now.generation
        models = drawn_models(self.settings, self._history.gains, self.parts, rng)
        how = self._given_up(calls, generation) or capabilities(generation)
        if isinstance(how, Failure):
            conversations = {part: unasked(calls, generation, part, how) for part in self.parts}
        else:
            conversations = self._answers(state, calls, how, models)
            if episodes := self._run_values(state).episodes:
                calls.transcript.add(Played(generation, "traces", episodes))
        missing = sum(outcome.value is None for outcome in conversations.values())
        backup = ask(self.fallback, state, rng) if missing else None
        guidance = Guidance(
            None, None, _source(missing, len(conversations)), notes=_notes(conversations)
        )
        edits: dict[Edit, str] = {}  # each once, with the first part that has it
        for part, outcome in conversations.items():
            for edit in () if outcome.value is None else outcome.value.edits:
                edits.setdefault(edit, part)
        if models and edits:
            names = " ".join(models[part] for part in edits.values())
            guidance = replace(guidance, notes={**guidance.notes, EDIT_MODELS: names})
        for part, outcome in conversations.items():
            if kind_of(part) == "edits":
                continue
            if (advice := outcome.value or backup) is not None:
                values = {name: getattr(advice, name) for name in FILLS[part]}
                guidance = replace(guidance, **values)
        return replace(guidance, edits=tuple(edits))

    def on_generation(self, generation: GenerationView) -> None:
        """See `GenerationListener`. Keeps the history, if prompts or checks use it."""
        if self.uses_history or self.settings.refuse_copies or self.context.edits:
            self._history = self._history.followed_by(generation)

    def too_short(self) -> str:
        """A line on first system prompts that the model's cache does not take; "" for none."""
        values = {**self.values, **self.settings.explore.values}
        values |= dict.fromkeys(_PER_GENERATION, "")
        requests = {}
        for part in self.parts:
            system, user = render(self.prompts[_PROMPTS[kind_of(part)][0]], values)
            requests[part] = Request(self.settings.model_name, system, (user,), 1)
        shared = shared_prompts(requests, self.settings)
        return too_short({part: request.system for part, request in shared.items()}, self.settings)

    @property
    def parts(self) -> list[str]:
        """The parts of the guidance that the model is asked for in each generation."""
        samples = range(1, self.settings.samples + 1) if self.context.edits else ()
        return [
            *["rate"] * self.context.adapt_mutation,
            *["tree"] * self.context.inject,
            *(f"edits {k}" if k > 1 else "edits" for k in samples),
        ]

    def _given_up(self, calls: Calls, generation: int) -> Failure | None:
        """The failure if the model is no longer asked, because of unusable answers; else None."""
        how, useless = self.settings.useless, calls.transcript.useless_before(generation)
        if how is None or len(useless) < how.most:
            return None
        last = f" (the last: {useless[-1].why})" if useless[-1].failed in CHARGED else ""
        if how.then == "stop":
            raise SupervisionError(
                f"Expected a usable answer of {self.settings.model_name}, found none to the last"
                f" {len(useless)} questions{last}; set another supervisor.policy.model, or raise"
                " supervisor.policy.useless.most."
            )
        return Failure(
            FailureKind.USELESS, f"no usable answer to {len(useless)} questions in a row{last}"
        )

    def _answers(
        self,
        state: PopulationState,
        calls: Calls,
        capabilities: ServerCapabilities,
        models: Mapping[str, str],
    ) -> dict[str, Conversation[Any]]:
        """Asks for all parts at the same time, or one by one if a cap is near."""
        requests = self.requests(state, capabilities, models)
        work = {p: partial(self._ask, p, state, calls, request) for p, request in requests.items()}
        room = calls.room_for(tuple(requests.values()), self.settings.repairs)
        # The first is asked in this thread, the others beside it.
        aside = {part: in_thread(work[part]) for part in [*work][1:] if room}
        return {part: aside[part].result() if part in aside else work[part]() for part in work}

    def _ask(
        self, part: str, state: PopulationState, calls: Calls, request: Request
    ) -> Conversation[Any]:
        """Asks for one part; chooses the best of several candidates for a tree."""
        how, generation = self.settings, state.now.generation
        check: Check[Any] = check_decision(how.rate)
        if part == "tree":
            size, most = self._tree_phase(state)[1], self.context.limits
            limits = Limits(
                min(size.most_depth, most.max_depth), min(size.most_nodes, most.max_nodes)
            )
            words = self.context.schema.vocabulary
            known = self._known() if how.refuse_copies else None
            check = check_proposal(limits, words, state.targets, how.candidates, known)
        if kind_of(part) == "edits":
            now, limits = self._history.now, self.context.limits
            living = {} if now is None else nameable(now)
            check = check_edits(living, self._known(), self.context.schema.vocabulary, limits)
        conversation = converse(
            calls, generation, part, request, check, repairs=how.repairs, repair=self._repair
        )
        if not isinstance(conversation.value, Proposal) or not conversation.value.others:
            return conversation
        chosen, played, note = try_out(conversation.value, state, self.context)
        calls.transcript.add(played)
        return replace(conversation, value=chosen, trial=note)

    def _known(self) -> frozenset[str]:
        """Canonical texts of the living trees and of the examples."""
        now = self._history.now
        return known_texts(() if now is None else nameable(now).values(), self._examples)

    def _tree_phase(self, state: PopulationState) -> tuple[str, TreeSize]:
        """Section 2.4.6: exploration until the milestone `exploit_from`, then exploitation."""
        how = self.settings
        exploiting = state.milestones_reached[self.exploit_from]
        return ("tree_exploit", how.exploit) if exploiting else ("tree_explore", how.explore)

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
        """The request for a part ("rate", "tree", "edits") alone; model=None: the settings'."""
        how, name = self.settings, "mutation_rate"
        answer: type[BaseModel] = DecisionAnswer
        values: dict[str, str] = {}
        if part == "tree":
            name, size = self._tree_phase(state)
            answer, values = proposal_model(state.targets, how.candidates), size.values
        if kind_of(part) == "edits":
            name, answer = "edits", EditsAnswer
        shape = self._order(schema(answer))
        system, user = render(
            self.prompts[name],
            {
                **self.values,
                **values,
                "generation": str(state.now.generation),
                "state": state_text(state, self.context.crisis),
                "urgency": urgency(state, how.rare),
                "answer": form(shape),
                "tree_field": _TREES_FIELD.format(how.candidates)
                if "trees" in shape["properties"]
                else _TREE_FIELD,
                **self._run_values(state).values,
            },
        )
        return Request(
            model=model or how.model_name,
            system=system,
            turns=(user,),
            max_tokens=how.reply_tokens,
            temperature=capabilities.temperature,
            schema=shape if capabilities.structured else None,
            cache=how.cache,
            thinking=how.thinking_value,
            effort=how.effort,
            extra=how.extra_body,
        )

    def _run_values(self, state: PopulationState) -> RunValues:
        """The prompts' values on the run so far; computed once per generation."""
        if self._last is None or self._last[0] is not state:
            result = NO_VALUES
            if self.uses_history:
                result = run_values(self.settings.informed, self.context, state, self._history)
            if self.context.edits:
                values, played = edit_values(self.context, self._history, self.settings.parents)
                result = RunValues({**result.values, **values}, result.episodes + played)
            self._last = (state, result)
        return self._last[1]

    def _repair(self, rejection: Rejection) -> str:
        values = {"stage": rejection.stage.value, "error": rejection.error}
        return render(self.prompts["repair"], {**self.values, **values})[1]


def _source(missing: int, requests: int) -> str:
    """The source of the guidance, as in the record."""
    if missing == 0:
        return "llm"
    return "fallback" if missing == requests else "llm and fallback"


def _notes(conversations: Mapping[str, Conversation[Any]]) -> dict[str, str]:
    """For the record: where each part comes from, and the hash of every prompt of it."""
    notes = {}
    for name, outcome in conversations.items():
        end = outcome.end
        notes[name] = end.source + (f": {end.why[:REASON]}" if end.why else "")
        if outcome.prompts:
            notes[f"{name}_prompts"] = " ".join(outcome.prompts)
        if outcome.trial:
            notes["trial"] = outcome.trial
        if end.rejected:
            notes[f"{name}_rejected"] = " ".join(end.rejected)
    return notes
