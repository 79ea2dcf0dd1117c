# SPDX-License-Identifier: GPL-3.0-or-later
"""An editor's session with nuc980-pins lsp, by a scripted client; and what it shows, without the protocol."""

from __future__ import annotations

import asyncio
import os
import sys
from collections.abc import Awaitable, Callable
from pathlib import Path

import pytest
from lsprotocol import types
from program import SD_HOST_ON, write
from pygls.lsp.client import LanguageClient
from trees import CHIP, ROOT, TABLE, gateway

from nuc980.pins.board import load_board
from nuc980.pins.checking import Checker
from nuc980.pins.editor import Source
from nuc980.pins.tree import Place

PATIENCE = 60
BOARD = load_board(TABLE, CHIP)
GOOD = gateway("")
SECOND = '&uart1 {\n    status = "okay";\n};\n'


@pytest.fixture
def source(tmp_path: Path) -> Source:
    return Source(write(tmp_path / "board.dts", ""), Checker(CHIP, BOARD, BOARD.package))


def shown(source: Source, line: str, mark: str = "|") -> tuple[str, int]:
    """A line and the cursor in it, which | stands for."""
    return line.replace(mark, ""), line.index(mark)


# ---- what an editor shows ----------------------------------------------------------------------------


def test_marks_are_of_what_is_written_and_not_of_what_is_saved(source: Source) -> None:
    assert source.marks(GOOD) == []
    text = GOOD + SD_HOST_ON
    marks = source.marks(text)
    conflict = next(mark for mark in marks if mark.rule == "pin-conflict")
    assert "sdh" in text.splitlines()[conflict.line]
    assert {Path(place.file).name for place, _ in conflict.related} == {"board.dts"}
    assert source.file.read_text() == GOOD


def test_a_mistake_of_syntax_is_at_its_line(source: Source) -> None:
    text = GOOD + "&uart1 {\n\tstatus = ;\n};\n"
    [mark] = source.marks(text)
    assert (mark.rule, text.splitlines()[mark.line]) == ("unusable", "\tstatus = ;")
    assert "board.dts" in mark.message


def test_a_finding_of_an_included_file_is_where_it_is_included(source: Source) -> None:
    (source.file.parent / "more.dtsi").write_text('&uart5 { status = "on"; };\n')
    text = GOOD + '#include "more.dtsi"\n'
    [mark] = source.marks(text)
    assert text.splitlines()[mark.line] == '#include "more.dtsi"'


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("\tnuvoton,pins = <0 0 4 0>, <5 1|0 2 0>;", "PF10 as UART1_TXD of uart1"),
        ("\t\t<4 7| 1 0>,", "PE7 as RMII0_TXD0"),
        ("\tgpios = <&gpio 1|39 0>;", "GPIO 139 is PE11"),
        ("\tpinctrl-0 = <&uart1|_pins>;", "uart1: /apb/serial@b0071000"),
        ("&em|ac1 {", "RMII1_REFCLK"),
        ("\t\t<0 0 4 0>; /* P|A0 UART1_RXD */", "PA0: GPIO 0"),
        ("\tstatus = |\"okay\";", None),
    ],
)  # fmt: skip
def test_hover(source: Source, line: str, says: str | None) -> None:
    text = source.hover(*shown(source, line))
    assert (says in text) if says and text else text == says


@pytest.mark.parametrize(
    ("line", "row"), [("&uart|1 {", "  uart1:"), ("<&emac0_|pins>", "  emac0:"), ("/* P|A0 */", "  uart1:")]
)
def test_definition_is_the_row_of_the_pin_table(source: Source, line: str, row: str) -> None:
    place = source.definition(*shown(source, line))
    assert place and place.file == str(TABLE)
    assert TABLE.read_text().splitlines()[place.line - 1] == row


def test_definition_of_another_label_is_in_the_sources(source: Source) -> None:
    source.marks(GOOD)
    place = source.definition(*shown(source, "&uart5| {"))
    assert place and place.file.endswith("soc.dtsi")


def test_definition_of_a_label_of_the_open_file_is_in_that_file(source: Source) -> None:
    source.marks(GOOD + "/ { mine: mine { }; };\n")
    assert source.definition(*shown(source, "&mi|ne {")) == Place(str(source.file), GOOD.count("\n") + 1)


@pytest.mark.parametrize("text", ["", "\n", "/dts-v1/;"])
def test_a_mark_of_a_text_without_a_tree_is_at_a_line(source: Source, text: str) -> None:
    [mark] = source.marks(text)
    assert (mark.rule, mark.line >= 0) == ("unusable", True)


def test_proposals(source: Source) -> None:
    source.marks(GOOD)

    def written(line: str) -> set[str]:
        return {one.written for one in source.proposals(*shown(source, line))}

    assert {"pinctrl_uart1", "pinctrl_emac0"} <= written("\tpinctrl-0 = <&|>;")
    assert "uart1" not in written("\tpinctrl-0 = <&|>;")
    assert {"uart1", "gpio"} <= written("&|")
    assert {"0 0 4 0", "5 10 2 0"} <= written("\tnuvoton,pins = <|")
    assert written('\tstatus = "|') == {"okay", "disabled"}
    assert {"nand-ecc-mode", "pinctrl-names"} <= written("\tn|")
    assert written("\tx = <1> |") == set()


def test_repairs(source: Source) -> None:
    text = GOOD + "&uart4 {\n\tport-number = <3>;\n\tpdma-enable = <7>;\n};\n"
    [mark] = [mark for mark in source.marks(text) if mark.rule == "wrong-number"]
    [(said, line, new)] = source.repairs(text, mark.line)
    assert (line, new) == (mark.line, "\tport-number = <4>;\n")
    assert "it must be 4" in said
    assert source.repairs(text, mark.line + 1) == []
    assert source.repairs(f"\n{text}", mark.line) == []
    broken = text.replace("&uart4 {", "&uart4 ")
    source.marks(broken)
    assert source.repairs(broken, mark.line) == []


# ---- the protocol ------------------------------------------------------------------------------------


class Client(LanguageClient):
    """Keeps what the server says of a file."""

    def __init__(self) -> None:
        super().__init__("editor", "1")
        self.told: asyncio.Queue[types.PublishDiagnosticsParams] = asyncio.Queue()

        @self.feature(types.TEXT_DOCUMENT_PUBLISH_DIAGNOSTICS)
        def told(said: types.PublishDiagnosticsParams) -> None:
            self.told.put_nowait(said)

    async def said(self, version: int) -> types.PublishDiagnosticsParams:
        """Of this version; of one before there may be an answer or none."""
        while (said := await self.told.get()).version != version:
            pass
        return said


def session(work: Callable[[Client], Awaitable[None]], *words: str) -> int | None:
    """Starts the server as an editor does, and ends it so."""

    async def run() -> int | None:
        client = Client()
        os.environ["PYTHONPATH"] = str(ROOT / "scripts")
        await client.start_io(sys.executable, "-m", "nuc980.pins", "lsp", *words)
        await client.initialize_async(types.InitializeParams(types.ClientCapabilities()))
        client.initialized(types.InitializedParams())
        await work(client)
        await client.shutdown_async(None)
        client.exit(None)
        server = client._server
        code = await server.wait()
        await client.stop()
        return code

    return asyncio.run(asyncio.wait_for(run(), PATIENCE))


def test_names_that_are_no_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "")
    gone = types.TextDocumentIdentifier((tmp_path / "gone.dts").as_uri())
    here = types.Position(0, 0)

    async def work(client: Client) -> None:
        for version, uri in enumerate(("file:///", "file:///a%00b.dts"), 1):
            item = types.TextDocumentItem(uri, "dts", version, "/dts-v1/;\n/ { };\n")
            client.text_document_did_open(types.DidOpenTextDocumentParams(item))
            assert (await client.said(version)).uri == uri
        assert await client.text_document_hover_async(types.HoverParams(gone, here)) is None
        assert await client.text_document_definition_async(types.DefinitionParams(gone, here)) is None
        assert not await client.text_document_code_action_async(
            types.CodeActionParams(gone, types.Range(here, here), types.CodeActionContext([]))
        )

    assert session(work, "--chip-only") == 0


@pytest.mark.slow
def test_a_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", "")
    file = write(tmp_path / "board.dts", "")
    uri, lines = file.as_uri(), GOOD.count("\n")

    async def work(client: Client) -> None:
        item = types.TextDocumentItem(uri, "dts", 1, GOOD)
        client.text_document_did_open(types.DidOpenTextDocumentParams(item))
        assert not (await client.said(1)).diagnostics

        def type_text(version: int, text: str) -> None:
            end = types.Position(lines, 0)
            client.text_document_did_change(
                types.DidChangeTextDocumentParams(
                    types.VersionedTextDocumentIdentifier(version, uri),
                    [types.TextDocumentContentChangePartial(types.Range(end, end), text)],
                )
            )

        type_text(2, '&uart5 { status = "okay"; };\n')
        type_text(3, SECOND)
        said = await client.said(3)
        assert {one.code for one in said.diagnostics} == {"no-pins"}
        assert said.diagnostics[0].range.start.line == lines + SECOND.count("\n")

        here = types.TextDocumentIdentifier(uri)
        hover = await client.text_document_hover_async(types.HoverParams(here, types.Position(lines, 3)))
        assert "uart1: /apb/serial@b0071000" in hover.contents.value
        row = await client.text_document_definition_async(
            types.DefinitionParams(here, types.Position(lines, 3))
        )
        assert row.uri == TABLE.as_uri()
        items = await client.text_document_completion_async(
            types.CompletionParams(here, types.Position(lines, 1))
        )
        assert "uart1" in {one.label for one in items}

        type_text(4, "&uart4 { port-number = <3>; };\n")
        await client.said(4)
        actions = await client.text_document_code_action_async(
            types.CodeActionParams(
                here, types.Range(end := types.Position(lines, 0), end), types.CodeActionContext([])
            )
        )
        assert actions[0].edit.changes[uri][0].new_text == "&uart4 { port-number = <4>; };\n"

    assert session(work) == 0
