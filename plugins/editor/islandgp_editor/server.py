"""The language server for tree files: `islandgp language-server`."""

from __future__ import annotations

import asyncio
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from lsprotocol import types
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.workspace import ServerTextPosition, TextDocument

from islandgp import __version__
from islandgp.bt.core.format import format_text
from islandgp.bt.core.includes import find_includes
from islandgp.bt.core.language import MAX_CHARACTERS
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY, Vocabulary
from islandgp.commands.check import findings
from islandgp.commands.files import TreeText
from islandgp.errors import IslandError, TreeError
from islandgp_editor.assist import completions, meaning
from islandgp_editor.names import Symbol, Word, defines, definitions, references, renamed, symbol_at

PAUSE: Final = 0.2  # s without a change before a text is checked
COMPLETION_KINDS: Final = {
    "action": types.CompletionItemKind.Function,
    "key": types.CompletionItemKind.Variable,
    "word": types.CompletionItemKind.Keyword,
    "subtree": types.CompletionItemKind.Class,
    "number": types.CompletionItemKind.Constant,
}
SYMBOLS: Final = {"subtree": types.SymbolKind.Function, "constant": types.SymbolKind.Constant}
WORD_OR_SIGN: Final = re.compile(r"\w+|&+|\|+|.")
REPLACEMENT: Final = re.compile(r"(use )?\w+|[<>=!]=?|[-{}\"]")  # suggestions that can be inserted

Words = Callable[[TreeText], Vocabulary]
"""The vocabulary for a text; raises IslandError."""


class Server(LanguageServer):
    """The server, with the vocabulary of each text and the domains that a file can name."""

    def __init__(self, vocabulary_for: Words, domains: Sequence[str]) -> None:
        super().__init__("islandgp", __version__)
        self.vocabulary_for, self.domains = vocabulary_for, domains
        for name, answer in ANSWERS.items():
            self.feature(name)(answer)
        with_check = types.RenameOptions(prepare_provider=True)
        self.feature(types.TEXT_DOCUMENT_RENAME, with_check)(rename)

    def document(self, uri: str) -> TextDocument:
        """A text in its present state in the editor."""
        return self.workspace.get_text_document(uri)

    def place(self, params: Any) -> tuple[TextDocument, int]:
        """The document of a request about a place, and the offset of that place."""
        document = self.document(params.text_document.uri)
        return document, document.offset_at_position(params.position)

    def known(self, document: TextDocument) -> Vocabulary:
        """The vocabulary of a text's domain; empty for an unknown domain."""
        try:
            return self.vocabulary_for(_tree_text(document))
        except IslandError:
            return EMPTY_VOCABULARY

    def check(self, document: TextDocument) -> None:
        """Publishes the errors and warnings of a text."""
        diagnostics = [
            _diagnostic(each, document) for each in _findings(document, self.vocabulary_for)
        ]
        self.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(document.uri, diagnostics, document.version)
        )


def opened(server: Server, params: types.DidOpenTextDocumentParams) -> None:
    """Checks a text when it is opened."""
    server.check(server.document(params.text_document.uri))


def saved(server: Server, _: types.DidSaveTextDocumentParams) -> None:
    """Checks all texts when one is saved, as others may include it."""
    for document in server.workspace.text_documents.values():
        server.check(document)


async def changed(server: Server, params: types.DidChangeTextDocumentParams) -> None:
    """Checks a text PAUSE seconds after its last change."""
    await asyncio.sleep(PAUSE)
    document = server.document(params.text_document.uri)
    if document.version == params.text_document.version:  # else it changed again, or is closed
        server.check(document)


def closed(server: Server, params: types.DidCloseTextDocumentParams) -> None:
    """Removes the diagnostics of a closed text."""
    server.text_document_publish_diagnostics(
        types.PublishDiagnosticsParams(params.text_document.uri, [])
    )


def completion(server: Server, params: types.CompletionParams) -> list[types.CompletionItem]:
    """Completions at a position."""
    document, at = server.place(params)
    if len(document.source) > MAX_CHARACTERS:
        return []
    vocabulary = server.known(document)
    found = completions(document.source, at, vocabulary, _folder(document), list(server.domains))
    return [
        types.CompletionItem(label=each.text, kind=COMPLETION_KINDS[each.sort], detail=each.detail)
        for each in found
    ]


def hover(server: Server, params: types.HoverParams) -> types.Hover | None:
    """The meaning of the word at a position."""
    document, at = server.place(params)
    hover_text = meaning(document.source, at, server.known(document), _folder(document))
    if hover_text is None:
        return None
    text, word = hover_text
    content = types.MarkupContent(types.MarkupKind.Markdown, text)
    return types.Hover(content, _range(document, word))


def formatting(server: Server, params: types.DocumentFormattingParams) -> list[types.TextEdit]:
    """The whole text in canonical form."""
    document = server.document(params.text_document.uri)
    text = document.source
    try:
        after = format_text(text, name=_name(document), folder=_folder(document))
    except TreeError:
        return []  # errors are shown as diagnostics
    if after == text:
        return []
    return [types.TextEdit(_range(document, Word(text, 0, len(text))), after)]


def prepare_rename(server: Server, params: types.PrepareRenameParams) -> types.Range | None:
    """The name of a subtree, a constant or a parameter at a place."""
    document, at = server.place(params)
    symbol = symbol_at(document.source, at)
    return _range(document, symbol.word) if symbol else None


def rename(server: Server, params: types.RenameParams) -> types.WorkspaceEdit:
    """The edits that rename a subtree, a constant or a parameter within its file."""
    document, at = server.place(params)
    try:
        places = renamed(document.source, at, params.new_name, _folder(document))
    except TreeError as error:
        raise JsonRpcInvalidParams(str(error)) from None
    edits = [types.TextEdit(_range(document, word), params.new_name) for word in places]
    return types.WorkspaceEdit(changes={document.uri: edits})


def definition(server: Server, params: types.DefinitionParams) -> types.Location | None:
    """The definition of the name at a place, in its file or in a file that it includes."""
    document, at = server.place(params)
    symbol = symbol_at(document.source, at)
    if symbol is None:
        return None
    for each in _files(server, document, symbol.symbol):
        if word := defines(each.source, symbol.symbol):
            return types.Location(each.uri, _range(each, word))
    return None


def uses(server: Server, params: types.ReferenceParams) -> list[types.Location]:
    """The uses of the name at a place, in its file and in the files that it includes."""
    document, at = server.place(params)
    symbol = symbol_at(document.source, at)
    if symbol is None:
        return []
    return [
        types.Location(each.uri, _range(each, word))
        for each in _files(server, document, symbol.symbol)
        for word in references(each.source, symbol.symbol)
        if params.context.include_declaration or word != defines(each.source, symbol.symbol)
    ]


def symbols(server: Server, params: types.DocumentSymbolParams) -> list[types.DocumentSymbol]:
    """The subtrees and constants that a file defines."""
    document = server.document(params.text_document.uri)
    return [
        types.DocumentSymbol(
            each.symbol.name,
            SYMBOLS[each.symbol.kind],
            _range(document, each.whole),
            _range(document, each.word),
        )
        for each in definitions(document.source)
        if each.whole
    ]


def code_actions(server: Server, params: types.CodeActionParams) -> list[types.CodeAction]:
    """Quick fixes in a range: replacements by the suggested words."""
    document = server.document(params.text_document.uri)
    actions: list[types.CodeAction] = []
    for error in _findings(document, server.vocabulary_for):
        diagnostic = _diagnostic(error, document)
        guess = error.get("guess", "")
        overlap = (
            diagnostic.range.start <= params.range.end
            and params.range.start <= diagnostic.range.end
        )
        if overlap and REPLACEMENT.fullmatch(guess) and error["file"] == _name(document):
            edit = _replacement(document, diagnostic.range.start, guess)
            actions.append(
                types.CodeAction(
                    f"Replace by {guess}",
                    kind=types.CodeActionKind.QuickFix,
                    diagnostics=[diagnostic],
                    is_preferred=True,
                    edit=types.WorkspaceEdit(changes={document.uri: [edit]}),
                )
            )
    return actions


def _replacement(document: TextDocument, start: types.Position, guess: str) -> types.TextEdit:
    """The edit that replaces the word or sign at `start` by a suggestion."""
    text, at = document.source, document.offset_at_position(start)
    match = WORD_OR_SIGN.match(text, at)
    end = match.end() if match else at
    if guess[-1].isalnum():  # a word in place of a sign, as in `a&&b`
        before = " " if at and text[at - 1].isalnum() else ""
        after = " " if text[end : end + 1].isalnum() else ""
        guess = f"{before}{guess}{after}"
    return types.TextEdit(_range(document, Word(text[at:end], at, end)), guess)


def _files(server: Server, document: TextDocument, symbol: Symbol) -> list[TextDocument]:
    """The file, with the files that it includes if a symbol may be defined there."""
    if symbol.kind == "parameter":
        return [document]
    included = find_includes(document.source, _folder(document))
    return [document, *(server.document(path.as_uri()) for path, text in included.items() if text)]


ANSWERS: Final[dict[str, Callable[..., Any]]] = {
    types.TEXT_DOCUMENT_DID_OPEN: opened,
    types.TEXT_DOCUMENT_DID_SAVE: saved,
    types.TEXT_DOCUMENT_DID_CHANGE: changed,
    types.TEXT_DOCUMENT_DID_CLOSE: closed,
    types.TEXT_DOCUMENT_COMPLETION: completion,
    types.TEXT_DOCUMENT_HOVER: hover,
    types.TEXT_DOCUMENT_FORMATTING: formatting,
    types.TEXT_DOCUMENT_PREPARE_RENAME: prepare_rename,
    types.TEXT_DOCUMENT_DEFINITION: definition,
    types.TEXT_DOCUMENT_REFERENCES: uses,
    types.TEXT_DOCUMENT_DOCUMENT_SYMBOL: symbols,
    types.TEXT_DOCUMENT_CODE_ACTION: code_actions,
}
"""By request; renaming has a separate option."""


def _findings(document: TextDocument, vocabulary_for: Words) -> list[dict[str, Any]]:
    """The errors and warnings of `check --json`; an unknown domain is an error at its position."""
    source = _tree_text(document)
    try:
        _, found = findings(source, vocabulary_for)
    except IslandError as error:
        place = {"line": 1, "column": 1, "end": 1, "severity": "error", "code": "domain"}
        return [{"file": source.name, **place, "message": str(error)}]
    return [{**each.plain(), "guess": each.error.guess} for each in found]


def _diagnostic(finding: dict[str, Any], document: TextDocument) -> types.Diagnostic:
    """The diagnostic of an error; one in an included file is shown at the top with its place."""
    line, message = finding["line"] - 1, finding["message"]
    columns = [finding["column"] - 1, finding["end"] - 1]
    if finding["file"] != _name(document):
        message = f"{finding['file']}:{finding['line']}:{finding['column']}: {message}"
        line, columns = 0, [0, 0]
    start, end = (
        document.position_to_client_units(ServerTextPosition(line, column)) for column in columns
    )
    error = finding["severity"] == "error"
    severity = types.DiagnosticSeverity.Error if error else types.DiagnosticSeverity.Warning
    return types.Diagnostic(
        types.Range(start, end), message, severity=severity, code=finding["code"], source="islandgp"
    )


def _range(document: TextDocument, word: Word) -> types.Range:
    places = (document.client_position_at_offset(offset) for offset in (word.start, word.end))
    return types.Range(*places)


def _tree_text(document: TextDocument) -> TreeText:
    return TreeText(document.source, _name(document), _folder(document))


def _name(document: TextDocument) -> str:
    return str(document.path or document.uri)


def _folder(document: TextDocument) -> Path:
    return Path(document.path).parent if document.path else Path.cwd()
