# SPDX-License-Identifier: GPL-3.0-or-later
"""What a board's memory and flash are: the pins' share of its image-limits.toml."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from nuc980.errors import UnusableInput


@dataclass(frozen=True)
class Area:
    """A part of the flash; bytes."""

    label: str
    offset: int
    size: int

    @property
    def end(self) -> int:
        return self.offset + self.size


@dataclass(frozen=True)
class Limits:
    """Sizes in bytes. The areas are None where the table has none."""

    file: Path
    memory: int
    flash: int
    block: int  # of the flash: what is erased at once
    boot: Area | None  # the boot loader and its environment
    kernel: Area | None  # where the factory's boot command reads it
    device_tree: Area | None
    root: Area | None  # where an image puts it
    page: int | None = None  # of the flash
    loaded: dict[str, range] = field(default_factory=dict)  # what the boot loader puts into memory: where

    @property
    def areas(self) -> tuple[Area, ...]:
        """Those whose place is agreed with a boot loader or an image."""
        return tuple(filter(None, (self.boot, self.kernel, self.device_tree, self.root)))


def load_limits(file: Path) -> Limits:
    """Raises UnusableInput for what cannot be read, and for a table without memory or flash."""
    try:
        data = tomllib.loads(file.read_text(encoding="utf-8"))
        flash = data["flash"]
        return Limits(
            file,
            memory=_size(data["memory"]["size"]),
            flash=_size(flash["size"]),
            block=_size(flash["block"]),
            page=_size(flash["page"]) if "page" in flash else None,
            loaded=dict(_loaded(data["memory"], flash)),
            **{name: _area(flash.get(name)) for name in ("boot", "kernel", "device_tree", "root")},
        )
    except OSError as error:
        raise UnusableInput(f"{file}: {error.strerror}; the pin table names it under limits") from error
    except (
        tomllib.TOMLDecodeError,
        UnicodeDecodeError,
        AttributeError,
        KeyError,
        TypeError,
        ValueError,
    ) as error:
        raise UnusableInput(
            f"{file}: {error!r}; it must be a table as board/nuc980/boards/gateway/image-limits.toml"
        ) from error


def _loaded(memory: dict[str, Any], flash: dict[str, Any]) -> Iterator[tuple[str, range]]:
    """The part of the flash as the boot command reads it to its place."""
    for what, place, part in (
        ("the kernel", "uimage", "kernel"),
        ("the device tree", "device_tree", "device_tree"),
    ):
        if place in memory and part in flash:
            yield what, range(memory[place], memory[place] + _size(flash[part]["size"]))


def _area(row: Any) -> Area | None:
    if row is None:
        return None
    if not isinstance(row["label"], str) or not isinstance(row["offset"], int) or row["offset"] < 0:
        raise ValueError(f"no label and offset: {row}")
    return Area(row["label"], row["offset"], _size(row["size"]))


def _size(value: Any) -> int:
    if not isinstance(value, int) or value <= 0:
        raise ValueError(f"no size in bytes: {value!r}")
    return value
