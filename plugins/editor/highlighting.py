"""Writes the TextMate grammar of the language, from its declarations.

python plugins/editor/highlighting.py
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.kinds import ABORTS, COUNTED, KEYWORDS, POLICIES, TIMED

TEXTMATE = Path(__file__).parent / "vscode" / "syntaxes" / "islandgp-bt.tmLanguage.json"

_A_NAME = r"[A-Za-z_]\w*"
_KEYWORD, _FUNCTION = "keyword.declaration", "entity.name.function"
_OTHER, _ASSIGNS = "variable.other", "keyword.operator.assignment"
_KEY = "variable.language"


def _rule(match: str, *names: str) -> dict[str, Any]:
    """A rule whose groups have scopes of these names."""
    captures = {str(at): {"name": name} for at, name in enumerate(names, 1)}
    return {"match": match, "captures": captures}


def textmate() -> str:
    """The TextMate grammar, as JSON."""
    rules: list[dict[str, Any]] = [
        {"name": "comment.line.number-sign", "match": "#.*$"},
        _rule(
            rf"\b(subtree)\s+({_A_NAME})\s*(\([^)]*\))\s*(=)", _KEYWORD, _FUNCTION, _OTHER, _ASSIGNS
        ),
        _rule(rf"\b(subtree)\s+({_A_NAME})\s*(=)", _KEYWORD, _FUNCTION, _ASSIGNS),
        _rule(
            rf"\b(constant)\s+({_A_NAME})\s*(=)\s*({_A_NAME})", _KEYWORD, _OTHER, _ASSIGNS, _OTHER
        ),
        _rule(rf"\b(constant)\s+({_A_NAME})\s*(=)", _KEYWORD, _OTHER, _ASSIGNS),
        _rule(r'\b(include)\s+("[^"]*")', _KEYWORD, "string.quoted.double"),
        {
            "match": r"\b(domain)\s+([A-Za-z_]\w*)",
            "captures": {
                "1": {"name": "keyword.declaration"},
                "2": {"name": "entity.name.namespace"},
            },
        },
        _rule(rf"\b(use)\s+({_A_NAME})\s*(\([^(:)]*\))", "keyword.other.use", _FUNCTION, _OTHER),
        _rule(rf"\b(use)\s+({_A_NAME})", "keyword.other.use", _FUNCTION),
        _rule(rf"\b({'|'.join([*COUNTED, *TIMED])})\s+({_A_NAME})", "keyword.control", _OTHER),
        _rule(rf"([<>]=?|[=!]=)\s*({_A_NAME})", "keyword.operator.comparison", _OTHER),
        _rule(rf"\b(when)\s+(?!not\b)({_A_NAME})", "keyword.control", _KEY),
        _rule(rf"\b(and|or|not)\s+(?!not\b)({_A_NAME})", "keyword.operator.logical", _KEY),
        _rule(rf"\(\s*(?!(?:not|use)\b)({_A_NAME})(?!\w|\s*[:(])", _KEY),
        _rule(rf"\b({_A_NAME})\s*:\s*({_A_NAME})", "variable.parameter", "constant.language"),
        _rule(rf"\b({_A_NAME})\s*:", "variable.parameter"),
        {"name": "keyword.control", "match": _any_of(KEYWORDS)},
        {"name": "keyword.other", "match": _any_of(["abort", "success", "failure"])},
        {"name": "keyword.operator.logical", "match": _any_of(["and", "or", "not"])},
        {"name": "constant.language", "match": _any_of([*ABORTS, *POLICIES])},
        {
            "name": "keyword.operator.comparison",
            "match": "|".join(sorted(OPERATORS, key=len, reverse=True)),
        },
        _rule(rf"[-+*/]\s*({_A_NAME})", _KEY),
        {"name": "keyword.operator.arithmetic", "match": "[-+*/]"},
        {"name": "constant.numeric", "match": r"-?\b\d+(\.\d+)?\b"},
        {"name": "support.function", "match": _A_NAME},
    ]
    grammar = {
        "name": "islandgp behaviour tree",
        "scopeName": "source.islandgp-bt",
        "fileTypes": ["bt"],
        "patterns": rules,
    }
    return json.dumps(grammar, indent=2) + "\n"


def _any_of(alternatives: Any) -> str:
    return rf"\b({'|'.join(alternatives)})\b"


if __name__ == "__main__":
    TEXTMATE.write_text(textmate(), encoding="utf-8")
