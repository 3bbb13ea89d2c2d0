"""What editors ask about tree files: the answers of `islandgp language-server`."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from lsprotocol import types
from pygls.exceptions import JsonRpcInvalidParams
from pygls.lsp.server import LanguageServer
from pygls.workspace import ServerTextPosition, TextDocument

from islandgp import __version__
from islandgp.bt.core.language import MAX_CHARACTERS, tree_errors
from islandgp.bt.core.node import Limits
from islandgp.bt.core.vocabulary import NOTHING, Vocabulary
from islandgp.bt.editor.assist import Word, meaning, offers, renamed, subtree_at
from islandgp.bt.editor.format import format_text
from islandgp.commands.check_command import checked, plain_error, plain_finding
from islandgp.errors import IslandError, TreeError

PAUSE: Final = 0.2  # s without a change before a text is checked
ANY_SIZE: Final = Limits(10**9, 10**9)
SORTS: Final = {
    "action": types.CompletionItemKind.Function,
    "key": types.CompletionItemKind.Variable,
    "word": types.CompletionItemKind.Keyword,
    "subtree": types.CompletionItemKind.Class,
    "number": types.CompletionItemKind.Constant,
}

Words = Callable[[str, str, Path], Vocabulary]
"""The vocabulary for a text, its name and its folder; raises IslandError."""


class Server(LanguageServer):
    """The server, with the words of each text and the domains that a file can name."""

    def __init__(self, words: Words, domains: Sequence[str]) -> None:
        super().__init__("islandgp", __version__)
        self.words, self.domains = words, domains
        for name, answer in ANSWERS.items():
            self.feature(name)(answer)
        with_check = types.RenameOptions(prepare_provider=True)
        self.feature(types.TEXT_DOCUMENT_RENAME, with_check)(rename)

    def document(self, uri: str) -> TextDocument:
        """A text as the editor has it now."""
        return self.workspace.get_text_document(uri)

    def place(self, params: Any) -> tuple[TextDocument, int]:
        """The document of a request about a place, and the offset of that place."""
        document = self.document(params.text_document.uri)
        return document, document.offset_at_position(params.position)

    def known(self, document: TextDocument) -> Vocabulary:
        """The words of a text's domain; none where it is for one that is not there."""
        try:
            return self.words(document.source, _name(document), _folder(document))
        except IslandError:
            return NOTHING

    def check(self, document: TextDocument) -> None:
        """Sends what is wrong with a text and doubtful in it."""
        found = [_diagnostic(each, document) for each in _found(document, self.words)]
        self.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(document.uri, found, document.version)
        )


def opened(server: Server, params: types.DidOpenTextDocumentParams) -> None:
    """A text is checked when it is opened."""
    server.check(server.document(params.text_document.uri))


def saved(server: Server, _: types.DidSaveTextDocumentParams) -> None:
    """All texts are checked when one is saved: others may include it."""
    for document in server.workspace.text_documents.values():
        server.check(document)


async def changed(server: Server, params: types.DidChangeTextDocumentParams) -> None:
    """A text is checked PAUSE after its last change."""
    await asyncio.sleep(PAUSE)
    document = server.document(params.text_document.uri)
    if document.version == params.text_document.version:  # else it changed again, or is closed
        server.check(document)


def closed(server: Server, params: types.DidCloseTextDocumentParams) -> None:
    """Nothing is wrong any more with a text that is closed."""
    server.text_document_publish_diagnostics(
        types.PublishDiagnosticsParams(params.text_document.uri, [])
    )


def completion(server: Server, params: types.CompletionParams) -> list[types.CompletionItem]:
    """What may stand at a place."""
    document, at = server.place(params)
    if len(document.source) > MAX_CHARACTERS:
        return []
    known = server.known(document)
    found = offers(document.source, at, known, _folder(document), list(server.domains))
    return [
        types.CompletionItem(label=each.text, kind=SORTS[each.sort], detail=each.detail)
        for each in found
    ]


def hover(server: Server, params: types.HoverParams) -> types.Hover | None:
    """What the word at a place means."""
    document, at = server.place(params)
    found = meaning(document.source, at, server.known(document), _folder(document))
    if found is None:
        return None
    text, word = found
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
    """The name of a subtree at a place."""
    document, at = server.place(params)
    word = subtree_at(document.source, at)
    return _range(document, word) if word else None


def rename(server: Server, params: types.RenameParams) -> types.WorkspaceEdit:
    """A subtree's name is changed wherever it stands."""
    document, at = server.place(params)
    try:
        places = renamed(document.source, at, params.new_name, _folder(document))
    except TreeError as error:
        raise JsonRpcInvalidParams(str(error)) from None
    edits = [types.TextEdit(_range(document, word), params.new_name) for word in places]
    return types.WorkspaceEdit(changes={document.uri: edits})


ANSWERS: Final[dict[str, Callable[..., Any]]] = {
    types.TEXT_DOCUMENT_DID_OPEN: opened,
    types.TEXT_DOCUMENT_DID_SAVE: saved,
    types.TEXT_DOCUMENT_DID_CHANGE: changed,
    types.TEXT_DOCUMENT_DID_CLOSE: closed,
    types.TEXT_DOCUMENT_COMPLETION: completion,
    types.TEXT_DOCUMENT_HOVER: hover,
    types.TEXT_DOCUMENT_FORMATTING: formatting,
    types.TEXT_DOCUMENT_PREPARE_RENAME: prepare_rename,
}
"""By request; renaming has an option of its own."""


def _found(document: TextDocument, words: Words) -> list[dict[str, Any]]:
    """What `check --json` finds in a text; a domain that is not there is an error of its place."""
    text, name, folder = document.source, _name(document), _folder(document)
    try:
        vocabulary = words(text, name, folder)
        if errors := tree_errors(text, vocabulary, name=name, folder=folder):
            return [plain_error(error, name) for error in errors]
        _, findings = checked(text, vocabulary, name, folder, ANY_SIZE)
    except TreeError as error:
        return [plain_error(error, name)]
    except IslandError as error:
        place = {"line": 1, "column": 1, "end": 1, "severity": "error", "code": "domain"}
        return [{"file": name, **place, "message": str(error)}]
    return [plain_finding(finding, text, name) for finding in findings]


def _diagnostic(found: dict[str, Any], document: TextDocument) -> types.Diagnostic:
    """Of an error in an included file, the message names its place, and it stands at the top."""
    line, message = found["line"] - 1, found["message"]
    columns = [found["column"] - 1, found["end"] - 1]
    if found["file"] != _name(document):
        message = f"{found['file']}:{found['line']}:{found['column']}: {message}"
        line, columns = 0, [0, 0]
    start, end = (
        document.position_to_client_units(ServerTextPosition(line, column)) for column in columns
    )
    error = found["severity"] == "error"
    severity = types.DiagnosticSeverity.Error if error else types.DiagnosticSeverity.Warning
    return types.Diagnostic(
        types.Range(start, end),
        message,
        severity=severity,
        code=found["code"],
        source="islandgp",
    )


def _range(document: TextDocument, word: Word) -> types.Range:
    places = (document.client_position_at_offset(offset) for offset in (word.start, word.end))
    return types.Range(*places)


def _name(document: TextDocument) -> str:
    return str(document.path or document.uri)


def _folder(document: TextDocument) -> Path:
    return Path(document.path).parent if document.path else Path.cwd()
