# SPDX-License-Identifier: GPL-3.0-or-later
"""The language server: an editor's side of editor.py, over standard input and output (pygls)."""

from __future__ import annotations

import asyncio
import re
from pathlib import Path

from lsprotocol import types
from pygls.lsp.server import LanguageServer
from pygls.uris import from_fs_path, to_fs_path

from nuc980 import VERSION
from nuc980.pins.checking import Checker
from nuc980.pins.editor import Mark, Source
from nuc980.pins.tree import Place

PAUSE = 0.25  # seconds without a key, before what is written is checked
LINE_ENDS = re.compile(r"\r\n|\r|\n")
UNNAMED = "unnamed.dts"
WIDEST = 1000  # a mark is of its whole line


class Editor:
    """The sources that an editor has open."""

    def __init__(self, server: LanguageServer, checker: Checker) -> None:
        self.server = server
        self.checker = checker
        self.sources: dict[str, Source] = {}
        self.checks: dict[str, asyncio.Task[None]] = {}

    def source(self, uri: str) -> Source:
        if uri not in self.sources:
            self.sources[uri] = Source(_file(uri), self.checker)
        return self.sources[uri]

    def text(self, uri: str) -> str:
        """As it is written; of a file that is neither open nor there, nothing."""
        try:
            return self.server.workspace.get_text_document(uri).source
        except (OSError, ValueError):
            return ""

    def line(self, at: types.TextDocumentPositionParams) -> str:
        lines = LINE_ENDS.split(self.text(at.text_document.uri))
        return lines[at.position.line] if at.position.line < len(lines) else ""

    def changed(self, uri: str, pause: float = PAUSE) -> None:
        """Checks when nobody has typed for a while; what is written meanwhile begins anew."""
        if uri in self.checks:
            self.checks[uri].cancel()
        self.checks[uri] = asyncio.get_running_loop().create_task(self._check(uri, pause))

    async def _check(self, uri: str, pause: float) -> None:
        await asyncio.sleep(pause)
        document = self.server.workspace.get_text_document(uri)
        version, text = document.version, document.source
        marks = await asyncio.to_thread(self.source(uri).marks, text)
        self.server.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(uri, [_diagnostic(mark) for mark in marks], version)
        )

    def closed(self, uri: str) -> None:
        self.sources.pop(uri, None)
        if check := self.checks.pop(uri, None):
            check.cancel()


def _file(uri: str) -> Path:
    """A name that cpp takes, also where the editor has none."""
    file = Path((to_fs_path(uri) or uri).replace("\0", "?"))
    return file if file.name else file / UNNAMED


def _range(line: int) -> types.Range:
    return types.Range(types.Position(line, 0), types.Position(line, WIDEST))


def _whole(line: int) -> types.Range:
    """With its end."""
    return types.Range(types.Position(line, 0), types.Position(line + 1, 0))


def _location(place: Place) -> types.Location:
    return types.Location(from_fs_path(str(Path(place.file).resolve())) or "", _range(place.line - 1))


def _diagnostic(mark: Mark) -> types.Diagnostic:
    return types.Diagnostic(
        _range(mark.line),
        mark.message,
        severity=types.DiagnosticSeverity.Error,
        code=mark.rule,
        source="nuc980-pins",
        related_information=[
            types.DiagnosticRelatedInformation(_location(place), wants) for place, wants in mark.related
        ],
    )


def serve(checker: Checker) -> None:
    """Until the editor ends it."""
    server = LanguageServer(
        "nuc980-pins", VERSION, text_document_sync_kind=types.TextDocumentSyncKind.Incremental
    )
    editor = Editor(server, checker)

    @server.feature(types.TEXT_DOCUMENT_DID_OPEN)
    async def opened(params: types.DidOpenTextDocumentParams) -> None:
        editor.changed(params.text_document.uri, pause=0)

    @server.feature(types.TEXT_DOCUMENT_DID_CHANGE)
    async def changed(params: types.DidChangeTextDocumentParams) -> None:
        editor.changed(params.text_document.uri)

    @server.feature(types.TEXT_DOCUMENT_DID_CLOSE)
    async def closed(params: types.DidCloseTextDocumentParams) -> None:
        editor.closed(params.text_document.uri)

    @server.feature(types.TEXT_DOCUMENT_HOVER)
    async def hover(at: types.HoverParams) -> types.Hover | None:
        text = editor.source(at.text_document.uri).hover(editor.line(at), at.position.character)
        return (
            types.Hover(types.MarkupContent(types.MarkupKind.Markdown, f"```text\n{text}\n```"))
            if text
            else None
        )

    @server.feature(types.TEXT_DOCUMENT_DEFINITION)
    async def definition(at: types.DefinitionParams) -> types.Location | None:
        place = editor.source(at.text_document.uri).definition(editor.line(at), at.position.character)
        return _location(place) if place else None

    @server.feature(
        types.TEXT_DOCUMENT_COMPLETION, types.CompletionOptions(trigger_characters=["&", "<", '"'])
    )
    async def completion(at: types.CompletionParams) -> list[types.CompletionItem]:
        proposals = editor.source(at.text_document.uri).proposals(editor.line(at), at.position.character)
        return [
            types.CompletionItem(one.shown, detail=one.about, insert_text=one.written) for one in proposals
        ]

    @server.feature(types.TEXT_DOCUMENT_CODE_ACTION)
    async def repair(params: types.CodeActionParams) -> list[types.CodeAction]:
        uri, line = params.text_document.uri, params.range.start.line
        text = editor.text(uri)
        return [
            types.CodeAction(
                f"nuc980-pins: {said}",
                types.CodeActionKind.QuickFix,
                edit=types.WorkspaceEdit({uri: [types.TextEdit(_whole(at), new)]}),
            )
            for said, at, new in editor.source(uri).repairs(text, line)
        ]

    server.start_io()
