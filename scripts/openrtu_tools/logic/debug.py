# SPDX-License-Identifier: GPL-3.0-or-later
"""Which slot of the machine's memory is which variable of the text, for a view of a running program."""

from __future__ import annotations

from collections.abc import Iterable

from openrtu_tools.logic.binary import Debug, Slot
from openrtu_tools.logic.layout import Enumeration, Stored, Type, elements_of
from openrtu_tools.logic.routine import Instance, Instances, Scope
from openrtu_tools.logic.syntax import Unit


def debug_of(
    program: Scope, functions: Iterable[Scope], units: Iterable[Unit], types: Iterable[Type]
) -> Debug:
    """Paths are in capitals, as `A`, `TIMER.ET`, `TABLE[3].HIGH`; those of a function begin with its name."""
    debug = Debug()
    places: dict[str, list[str]] = {program.unit.name: [""]}
    add_scope(debug, places, program, "")
    for scope in functions:
        places[scope.unit.name] = [f"{scope.unit.name}."]
        add_scope(debug, places, scope, f"{scope.unit.name}.")
    debug.enumerations = {
        kind.name: {number: name for name, number in kind.values.items()}
        for kind in types
        if isinstance(kind, Enumeration)
    }
    debug.units = sorted((unit.place.line, places.get(unit.name, [])) for unit in units)
    return debug


def add_scope(debug: Debug, places: dict[str, list[str]], scope: Scope, path: str) -> None:
    for name, bound in scope.names.items():
        match bound.what:
            case Slot():
                debug.variables[path + name] = bound.what
            case Stored():
                for element, slot in elements_of(bound.what):
                    debug.variables[path + name + element] = slot
            case Instance():
                add_instance(debug, places, bound.what, path + name)
            case Instances():
                for place, one in zip(bound.what.places, bound.what.elements, strict=True):
                    add_instance(debug, places, one, f"{path}{bound.variable.name}{place}")


def add_instance(debug: Debug, places: dict[str, list[str]], instance: Instance, path: str) -> None:
    unit = instance.unit
    places.setdefault(unit.name, []).append(f"{path}.")
    debug.outputs[path] = [variable.name for variable in unit.variables if variable.section == "VAR_OUTPUT"]
    add_scope(debug, places, instance.scope, f"{path}.")
