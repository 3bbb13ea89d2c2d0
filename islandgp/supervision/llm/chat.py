"""The chat-completions interface of OpenAI, llama.cpp, vLLM, Ollama and LM Studio."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Final

from islandgp.supervision.llm.message import Failure, FailureKind, Reply, Request, Usage, clean

STOPS: Final = {"stop": "end_turn", "length": "max_tokens", "content_filter": "refusal"}
"""The names of the Messages API for the reasons why an answer ended."""


def chat_body(request: Request) -> dict[str, Any]:
    """The body of a request."""
    roles = ("user", "assistant")
    system = [{"role": "system", "content": request.system}] if request.system else []
    turns = [{"role": roles[i % 2], "content": text} for i, text in enumerate(request.turns)]
    answer = {"name": "answer", "strict": True, "schema": request.schema}
    optional = {
        "temperature": request.temperature,
        "reasoning_effort": request.effort,
        "response_format": request.schema and {"type": "json_schema", "json_schema": answer},
        "grammar": request.grammar,  # llama.cpp
        "structured_outputs": request.grammar and {"grammar": request.grammar},  # vLLM
    }
    return {
        "model": request.model,
        "messages": [*system, *turns],
        "max_tokens": request.max_tokens,
        **{key: value for key, value in optional.items() if value is not None},
        **(request.extra or {}),
    }


def read_chat(
    body: bytes, line: Callable[[str], str], hide: Callable[[str], str]
) -> Reply | Failure:
    """Reads the body of an answer; `line` and `hide` as for `wire.read_message`."""
    try:
        answer = json.loads(body)
        if "choices" not in answer and "error" in answer:
            error = answer["error"]
            text = error.get("message", error) if isinstance(error, dict) else error
            return Failure(FailureKind.MALFORMED, f"status 200 with an error: {line(str(text))}")
        choice = answer["choices"][0]
        message, stop = choice["message"], str(choice.get("finish_reason") or "")
        stop = "refusal" if message.get("refusal") else STOPS.get(stop, stop)
        text, thinking = message.get("content") or "", message.get("reasoning_content") or ""
        usage = _usage(answer.get("usage") or {})
        return Reply(clean(hide(text)), line(stop), usage, clean(hide(thinking)))
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError) as error:
        start = line(body.decode("utf-8", "replace"))[:80]
        return Failure(
            FailureKind.MALFORMED,
            f"expected a chat completion, found a body of {len(body)} bytes that begins with"
            f" {start!r} ({type(error).__name__})",
        )


def _usage(counts: dict[str, Any]) -> Usage | None:
    """The usage of an answer; None if the server does not count. Raises TypeError."""
    details = counts.get("prompt_tokens_details") or {}
    tokens = [counts.get(f"{name}_tokens") or 0 for name in ("prompt", "completion")]
    tokens.append(details.get("cached_tokens") or 0)
    if not all(type(value) is int and 0 <= value < 1e9 for value in tokens):
        raise TypeError("expected numbers of tokens")
    prompt, output, cached = tokens
    return Usage(max(0, prompt - cached), output, cached) if prompt else None
