"""`islandgp language-server`: what editors ask about tree files, over standard input and output."""

from __future__ import annotations

import asyncio
import logging
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from islandgp.bt.assist import Word, meaning, offers, renamed, subtree_at
from islandgp.bt.format import format_text
from islandgp.bt.language import MAX_CHARACTERS
from islandgp.bt.node import Limits
from islandgp.bt.vocabulary import Vocabulary
from islandgp.commands.check_command import checked, plain_error, plain_finding
from islandgp.commands.setting import (
    Chosen,
    configured_domains,
    vocabulary_of,
    with_vocabulary_options,
)
from islandgp.errors import ConfigError, IslandError, TreeError

if TYPE_CHECKING:
    from lsprotocol import types
    from pygls.lsp.server import LanguageServer
    from pygls.workspace import TextDocument

PAUSE: Final = 0.2  # s without a change before a text is checked
ANY_SIZE: Final = Limits(10**9, 10**9)


@click.command()
@with_vocabulary_options
def command(chosen: Chosen) -> None:
    """Serve an editor over standard input and output (Language Server Protocol).

    Errors and warnings of `islandgp check`, completion and meanings of actions and keys, format,
    and rename of subtrees, for the domain that a file names. docs/language.md has the lines for
    editors.
    """
    if find_spec("pygls") is None:
        raise ConfigError("Expected pygls, found it not installed; pip install 'islandgp[lsp]'")

    if sys.stdin is None or sys.stdout is None:
        raise ConfigError(
            "Expected an editor at the standard input and output, found them closed; let the editor"
            " start this command"
        )

    def words(text: str, name: str, folder: Path) -> Vocabulary:
        return vocabulary_of(text, chosen, name=name, folder=folder)

    server = made(words, configured_domains(chosen.config_dir))
    stream = sys.stdout.buffer
    sys.stdout = sys.stderr  # what a domain's code prints is no message of the protocol
    # The editor shows errors of a request; pygls would log them with a traceback.
    logging.getLogger("pygls").setLevel(logging.CRITICAL)
    server.start_io(stdout=stream)


def made(words: Callable[[str, str, Path], Vocabulary], domains: list[str]) -> LanguageServer:
    """The server.

    Args:
        words: the vocabulary for a text, its name and its folder; raises IslandError.
        domains: that a file can name.
    """
    from lsprotocol import types
    from pygls.exceptions import JsonRpcInvalidParams
    from pygls.lsp.server import LanguageServer

    from islandgp import __version__

    server = LanguageServer("islandgp", __version__)
    sorts = {
        "action": types.CompletionItemKind.Function,
        "key": types.CompletionItemKind.Variable,
        "word": types.CompletionItemKind.Keyword,
        "subtree": types.CompletionItemKind.Class,
        "number": types.CompletionItemKind.Constant,
    }

    def asked(params: Any) -> tuple[TextDocument, int]:
        """The document of a request about a place, and the offset of that place."""
        document = server.workspace.get_text_document(params.text_document.uri)
        return document, document.offset_at_position(params.position)

    def known(document: TextDocument) -> Vocabulary:
        """The words of a text's domain; none where it is for one that is not there."""
        try:
            return words(document.source, _name(document), _folder(document))
        except IslandError:
            return Vocabulary("nothing", {}, {})

    def check(document: TextDocument) -> None:
        """Sends what is wrong with a text and doubtful in it."""
        found = [_diagnostic(each, document) for each in _found(document, words)]
        server.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(document.uri, found, document.version)
        )

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    def opened(params: types.DidOpenTextDocumentParams) -> None:
        check(server.workspace.get_text_document(params.text_document.uri))

    @server.feature(types.TEXT_DOCUMENT_DID_SAVE)
    def saved(_: types.DidSaveTextDocumentParams) -> None:
        for document in server.workspace.text_documents.values():  # others may include it
            check(document)

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    async def changed(params: types.DidChangeTextDocumentParams) -> None:
        await asyncio.sleep(PAUSE)
        document = server.workspace.get_text_document(params.text_document.uri)
        if document.version == params.text_document.version:  # else it changed again, or is closed
            check(document)

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    def closed(params: types.DidCloseTextDocumentParams) -> None:
        server.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(params.text_document.uri, [])
        )

    @server.feature(types.TEXT_DOCUMENT_COMPLETION)
    def completion(params: types.CompletionParams) -> list[types.CompletionItem]:
        document, at = asked(params)
        if len(document.source) > MAX_CHARACTERS:
            return []
        found = offers(document.source, at, known(document), _folder(document), domains)
        return [
            types.CompletionItem(label=each.text, kind=sorts[each.sort], detail=each.detail)
            for each in found
        ]

    @server.feature(types.TEXT_DOCUMENT_HOVER)
    def hover(params: types.HoverParams) -> types.Hover | None:
        document, at = asked(params)
        found = meaning(document.source, at, known(document), _folder(document))
        if found is None:
            return None
        told, word = found
        content = types.MarkupContent(types.MarkupKind.Markdown, told)
        return types.Hover(content, _range(document, word))

    @server.feature(types.TEXT_DOCUMENT_FORMATTING)
    def formatting(params: types.DocumentFormattingParams) -> list[types.TextEdit]:
        document = server.workspace.get_text_document(params.text_document.uri)
        text = document.source
        try:
            after = format_text(text, name=_name(document), folder=_folder(document))
        except TreeError:
            return []  # what is wrong is told as a diagnostic
        if after == text:
            return []
        return [types.TextEdit(_range(document, Word(text, 0, len(text))), after)]

    @server.feature(types.TEXT_DOCUMENT_PREPARE_RENAME)
    def prepare_rename(params: types.PrepareRenameParams) -> types.Range | None:
        document, at = asked(params)
        word = subtree_at(document.source, at)
        return _range(document, word) if word else None

    @server.feature(types.TEXT_DOCUMENT_RENAME, types.RenameOptions(prepare_provider=True))
    def rename(params: types.RenameParams) -> types.WorkspaceEdit:
        document, at = asked(params)
        try:
            places = renamed(document.source, at, params.new_name, _folder(document))
        except TreeError as error:
            raise JsonRpcInvalidParams(str(error)) from None
        edits = [types.TextEdit(_range(document, word), params.new_name) for word in places]
        return types.WorkspaceEdit(changes={document.uri: edits})

    return server


def _found(
    document: TextDocument, words: Callable[[str, str, Path], Vocabulary]
) -> list[dict[str, Any]]:
    """What `check --json` finds in a text; a domain that is not there is an error of its place."""
    text, name, folder = document.source, _name(document), _folder(document)
    try:
        vocabulary = words(text, name, folder)
        _, findings = checked(text, vocabulary, name, folder, ANY_SIZE)
    except TreeError as error:
        return [plain_error(error, name)]
    except IslandError as error:
        place = {"line": 1, "column": 1, "end": 1, "severity": "error", "code": "domain"}
        return [{"file": name, **place, "message": str(error)}]
    return [plain_finding(finding, text, name) for finding in findings]


def _diagnostic(found: dict[str, Any], document: TextDocument) -> types.Diagnostic:
    """Of an error in an included file, the message names its place, and it stands at the top."""
    from lsprotocol import types
    from pygls.workspace import ServerTextPosition

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
    from lsprotocol import types

    places = (document.client_position_at_offset(offset) for offset in (word.start, word.end))
    return types.Range(*places)


def _name(document: TextDocument) -> str:
    return str(document.path or document.uri)


def _folder(document: TextDocument) -> Path:
    return Path(document.path).parent if document.path else Path.cwd()
