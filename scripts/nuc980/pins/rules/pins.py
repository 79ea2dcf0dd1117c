# SPDX-License-Identifier: GPL-3.0-or-later
"""Rules on single pins: who claims them, and whether they can be what is asked."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence

from nuc980.pins.chip import GPIO
from nuc980.pins.claims import GPIO_CONTROLLER, Claim, MalformedError, gpio_specifiers, is_gpio_list
from nuc980.pins.findings import Finding, at
from nuc980.pins.rules.context import (
    Context,
    cells_of,
    claimants,
    functions_of_pin,
    grouped,
    in_order,
    listed,
    places_of_signal,
    ranged,
    rule,
)
from nuc980.pins.tree import Node

# GPIO expanders by the name of their part: how many lines they have.
EXPANDERS = {
    **dict.fromkeys(
        ("pcf8574", "pca9534", "pca9538", "pca9554", "pca9557", "tca6408", "tca9538", "tca9554"), 8
    ),
    **dict.fromkeys(("mcp23008", "mcp23s08", "max7310"), 8),
    **dict.fromkeys(
        ("pcf8575", "pca9535", "pca9539", "pca9555", "tca6416", "tca9535", "tca9539", "tca9555"), 16
    ),
    **dict.fromkeys(("mcp23017", "mcp23s17", "mcp23018"), 16),
    "tca6424": 24,
    "pca9505": 40,
}


@rule(
    "pin-conflict",
    "Two enabled devices have the same pin in their pin groups.",
    "The kernel gives the pin to the device that probes first and refuses the other (-EINVAL). What works "
    "depends on the order of the drivers.",
)
def pin_conflict(context: Context) -> Iterator[Finding]:
    by_pin = grouped((claim for claim in context.claims if claim.muxed), lambda claim: claim.pin)
    rivals = {
        pin: tuple(dict.fromkeys(claim.node for claim in claims))
        for pin, claims in by_pin.items()
        if pin in context.chip.pins
    }
    contested = {pin: nodes for pin, nodes in rivals.items() if len(nodes) > 1}
    for nodes, pins in grouped(contested, contested.get).items():
        # The one to switch off comes first: who looks at the finding looks there.
        first, *others = sorted(nodes, key=lambda node: _standing(context, node))
        names = listed(context.name(node) for node in (first, *others))
        yield Finding(
            "pin-conflict",
            **at(first, "status"),
            message=f"{names} {'both' if len(nodes) == 2 else 'all'} have {ranged(in_order(pins))} in "
            "their pin groups",
            remedy=_disable(context, first, others),
            claimants=claimants([claim for pin in in_order(pins) for claim in by_pin[pin]]),
            pins=in_order(pins),
        )


def _standing(context: Context, node: Node) -> int:
    """How sure a device's right to its pins is: 0 when the pin table does not have it, 1 when a default."""
    if context.board and node in context.devices:
        return 2 if context.devices[node].label in context.board.devices else 0
    return 1 if _is_default(node) else 2


def _is_default(node: Node) -> bool:
    """Whether a node is on only because an include leaves it on."""
    place = node.place_of("status")
    return place is not None and place.file.endswith(".dtsi")


def _disable(context: Context, first: Node, others: Sequence[Node]) -> str:
    name = context.name(first)
    if _standing(context, first) == 0:
        return f'Set status = "disabled" in {name}, which is not in the pin table, or give it other pins'
    names = [name, *map(context.name, others)]
    which = f"{name} or {names[1]}" if len(names) == 2 else f"all but one of {listed(names)}"
    hint = f" ({name} is enabled only by default, {first.place_of('status')})" if _is_default(first) else ""
    return f'Set status = "disabled" in {which}{hint}, or use groups with other pins'


@rule(
    "mux-and-gpio",
    "A pin is in the pin group of a device and is also used as a GPIO line.",
    "The vendor's GPIO driver refuses a pin whose function is not GPIO (-EINVAL). The vendor's keys driver "
    "switches the pin's direction under the device. Neither asks the pin controller.",
)
def mux_and_gpio(context: Context) -> Iterator[Finding]:
    muxed = grouped((claim for claim in context.claims if claim.muxed), lambda claim: claim.pin)
    clashes = []
    for line in context.claims:
        if line.muxed or line.pin not in context.chip.pins:
            continue
        rivals = [claim for claim in muxed.get(line.pin, ()) if claim.signal != GPIO]
        clashes += [(rival, line) for rival in rivals if not _takes_turns(muxed[line.pin], rival, line)]
    for (user, owner), pairs in grouped(clashes, lambda pair: (pair[1].node, pair[0].node)).items():
        pins = in_order(line.pin for _, line in pairs)
        use = _gpio_use(pairs[0][1])
        yield Finding(
            "mux-and-gpio",
            **at(user, pairs[0][1].property),
            message=f"{context.name(user)} uses {ranged(pins)} as GPIO ({use}), "
            f"but the pin group of {context.name(owner)} makes it "
            f"{listed(dict.fromkeys(claim.signal or f'function {claim.value}' for claim, _ in pairs))}",
            remedy=f"Take {ranged(pins)} out of {use} of {context.name(user)} or out of the group "
            f"{pairs[0][0].group.name} of {context.name(owner)}, or disable one of the two",
            claimants=claimants([claim for claim, _ in pairs]) + claimants([line for _, line in pairs]),
            pins=pins,
        )


def _takes_turns(muxed: Sequence[Claim], rival: Claim, line: Claim) -> bool:
    """Whether a device has another state that makes the pin its GPIO: how an I2C bus is freed."""
    return line.node is rival.node and any(
        claim.node is line.node and claim.signal == GPIO for claim in muxed if claim is not rival
    )


def _gpio_use(line: Claim) -> str:
    return "its interrupts" if line.interrupts else line.property


@rule(
    "gpio-conflict",
    "Two users claim the same GPIO line.",
    "The kernel gives a line to one user and refuses the next (-EBUSY). The vendor's keys driver does not "
    "ask; it takes the line from its owner.",
)
def gpio_conflict(context: Context) -> Iterator[Finding]:
    lines = grouped((claim for claim in context.claims if not claim.muxed), lambda claim: claim.pin)
    for pin, users in lines.items():
        # A device's interrupt may be a line that it reads as well.
        users = [
            user
            for user in users
            if not user.interrupts
            or not any(other.node is user.node and other is not user for other in users)
        ]
        if len(users) < 2 or pin not in context.chip.pins or all(map(_shares_its_line, users)):
            continue
        names = [f"{context.name(user.node)} ({_gpio_use(user)})" for user in users]
        yield Finding(
            "gpio-conflict",
            **at(users[-1].node, users[-1].property),
            message=f"{pin} is a GPIO line of {listed(names)}",
            remedy=f"Give {names[-1]} the line that it is wired to, or take {pin} from {listed(names[:-1])}",
            claimants=claimants(users),
            pins=(pin,),
        )


@rule(
    "expander-line",
    "Two users claim the same line of a GPIO expander, or a line that it does not have.",
    "The kernel gives a line to one user and refuses the next (-EBUSY). A line that is not there is -EINVAL, "
    "and a group of lamps or keys with one such line is missing whole.",
)
def expander_line(context: Context) -> Iterator[Finding]:
    users: dict[tuple[Node, int], list[tuple[Node, str]]] = {}
    for node in context.enabled:
        for name in filter(is_gpio_list, node.properties):
            with contextlib.suppress(MalformedError):
                for controller, cells in gpio_specifiers(context.tree, node, name):
                    if GPIO_CONTROLLER not in controller.strings("compatible"):
                        users.setdefault((controller, cells[0]), []).append((node, name))
    for (controller, line), its in users.items():
        node, name = its[-1]
        names = [f"{context.name(user)} ({used})" for user, used in its]
        shared = all("regulator-fixed" in user.strings("compatible") for user, _ in its)
        lines = _lines_of(controller)
        if lines is not None and line >= lines:
            fault = f"{listed(names)} wants line {line} of {context.name(controller)}, which has {lines}"
        elif len(its) > 1 and not shared:
            fault = f"line {line} of {context.name(controller)} is of {listed(names)}"
        else:
            continue
        yield Finding(
            "expander-line",
            **at(node, name),
            message=fault,
            remedy=f"Give {names[-1]} the line that it is wired to",
        )


def _lines_of(controller: Node) -> int | None:
    """How many lines an expander has; None: nobody knows."""
    for told in controller.cells("ngpios")[:1]:
        return told
    parts = (name.rpartition(",")[2] for name in controller.strings("compatible"))
    return next((EXPANDERS[part] for part in parts if part in EXPANDERS), None)


def _shares_its_line(user: Claim) -> bool:
    """Whether a driver lets others have its line: one pin can switch several supplies (fixed.c)."""
    return "regulator-fixed" in user.node.strings("compatible")


@rule(
    "no-such-pin",
    "The tree uses a pin or a GPIO number that the chip does not have.",
    "The driver accepts seven banks of 16 pins, but bank B ends at PB13, E at PE12 and F at PF12. The "
    "setting goes to reserved bits, and the device does not get its pin.",
)
def no_such_pin(context: Context) -> Iterator[Finding]:
    for node, claims in context.claims_of.items():
        missing = [claim for claim in claims if claim.pin not in context.chip.pins]
        for name, wrong in grouped(missing, lambda claim: claim.property).items():
            pins = in_order(claim.pin for claim in wrong)
            where = f"the group {wrong[0].group.name}" if wrong[0].group else name
            yield Finding(
                "no-such-pin",
                **at(node, name),
                message=f"{context.name(node)} wants {ranged(pins)} in {where}; the chip has no such pin",
                remedy=f"Put the right pin into {where}: banks are 0 (A, pins 0 to 15), 1 (B, 0 to 13), 2 "
                "(C), 3 (D), 4 (E, 0 to 12), 5 (F, 0 to 12), 6 (G); a GPIO number is 32 * bank + pin",
                claimants=claimants(wrong),
                pins=pins,
            )


@rule(
    "no-such-function",
    "A group selects a function that the pin does not have.",
    "The driver writes any value from 0 to 15 into the pin's multi-function field. With a reserved value "
    "the device does not get its pin, and nothing is logged.",
)
def no_such_function(context: Context) -> Iterator[Finding]:
    for node, claims in context.claims_of.items():
        wrong = [claim for claim in claims if claim.signal is None and claim.pin in context.chip.pins]
        if not wrong:
            continue
        pins = in_order(claim.pin for claim in wrong)
        what = listed(dict.fromkeys(f"function {claim.value} of {claim.pin}" for claim in wrong))
        can = "; ".join(f"{pin} can be {functions_of_pin(context.chip, pin)}" for pin in pins)
        yield Finding(
            "no-such-function",
            **at(node, wrong[0].property),
            message=f"{context.name(node)} wants {what}, which does not exist",
            remedy=f"Change the third cell of {ranged(pins)} in the group {wrong[0].group.name}: {can}",
            claimants=claimants(wrong),
            pins=pins,
        )


@rule(
    "foreign-function",
    "A pin in the group of one device has the function of another device.",
    "The pin is switched to the other device, which may be disabled. This device does not get its signal, "
    "and no driver can notice.",
)
def foreign_function(context: Context) -> Iterator[Finding]:
    for node, claims in context.claims_of.items():
        functions = grouped(
            (claim for claim in claims if claim.muxed), lambda claim: (claim.property, claim.pin)
        )
        wrong = [
            claim
            for same_pin in functions.values()
            if len({claim.value for claim in same_pin}) == 1  # else pin-twice
            for claim in same_pin[:1]
            if context.is_foreign(claim)
        ]
        if not wrong:
            continue
        pins = in_order(claim.pin for claim in wrong)
        name = context.name(node)
        what = listed(f"{claim.pin} as {claim.signal}" for claim in wrong)
        yield Finding(
            "foreign-function",
            **at(node, wrong[0].property),
            message=f"{name} takes {what}, which it cannot use",
            remedy=f"Change the group {wrong[0].group.name}: "
            + "; ".join(_own_functions(context, node, pin) for pin in pins),
            claimants=claimants(wrong),
            pins=pins,
        )


def _own_functions(context: Context, node: Node, pin: str) -> str:
    own = [
        f"{cells_of(pin, value)} for {signal}"
        for value, signal in context.chip.pins[pin].items()
        if context.peripherals[node].owns(signal)
    ]
    return (
        f"{pin} needs {' or '.join(own)}"
        if own
        else f"{pin} has no signal of {context.name(node)}; take it out"
    )


@rule(
    "pin-twice",
    "A device lists the same pin twice.",
    "With different functions, both settings are written and the later one stays, so the first signal is "
    "missing. With the same function, it is usually a line that was copied for another pin.",
)
def pin_twice(context: Context) -> Iterator[Finding]:
    for node in context.claims_of:
        for (_, pin), claims in grouped(
            context.muxed(node), lambda claim: (claim.property, claim.pin)
        ).items():
            if len(claims) < 2 or pin not in context.chip.pins:
                continue
            functions = [f"{claim.signal or 'nothing'} ({claim.value})" for claim in claims]
            yield Finding(
                "pin-twice",
                **at(node, claims[0].property),
                message=f"{context.name(node)} has {pin} as {listed(functions)}",
                remedy=f"Keep only one of the entries for {pin} in "
                f"{listed(dict.fromkeys(claim.group.name for claim in claims))}",
                claimants=claimants(claims),
                pins=(pin,),
            )


@rule(
    "signal-twice",
    "A device has the same signal on two pins.",
    "An output appears on both pins; of an input, only one pin counts. It is usually a typing error for a "
    "signal that is missing, as in the vendor's uart9-PB-PE with two RTS.",
)
def signal_twice(context: Context) -> Iterator[Finding]:
    for node in context.claims_of:
        known = [claim for claim in context.muxed(node) if claim.signal not in (None, GPIO)]
        for (_, signal), claims in grouped(known, lambda claim: (claim.property, claim.signal)).items():
            pins = in_order(claim.pin for claim in claims)
            if len(pins) < 2:
                continue
            yield Finding(
                "signal-twice",
                **at(node, claims[0].property),
                message=f"{context.name(node)} has {signal} on {ranged(pins)}",
                remedy=f"Keep only one of them in the group {claims[0].group.name}; {signal} can be on "
                f"{places_of_signal(context.chip, signal)}",
                claimants=claimants(claims),
                pins=pins,
            )


@rule(
    "not-bonded",
    "A device uses a pin that the package does not bring out.",
    "The chip has the pin inside, but the package has no leg for it. The signal goes nowhere.",
)
def not_bonded(context: Context) -> Iterator[Finding]:
    if context.package is None:
        return
    for node, claims in context.claims_of.items():
        hidden = [
            claim
            for claim in claims
            if claim.pin in context.chip.pins and claim.pin not in context.package.bonded
        ]
        if not hidden:
            continue
        pins = in_order(claim.pin for claim in hidden)
        elsewhere = [
            f"{signal} is also on {listed(others)}"
            for signal in dict.fromkeys(claim.signal for claim in hidden if claim.signal not in (None, GPIO))
            if (others := [pin for pin, _ in context.chip.signals[signal] if pin in context.package.bonded])
        ]
        hint = f" ({'; '.join(elsewhere)})" if elsewhere else ""
        yield Finding(
            "not-bonded",
            **at(node, hidden[0].property),
            message=f"{context.name(node)} wants {ranged(pins)}, which the package {context.package.name} "
            "does not bring out",
            remedy=f"Move {ranged(pins)} to pins of the package{hint}, or disable {context.name(node)}",
            claimants=claimants(hidden),
            pins=pins,
        )


RULES = (
    pin_conflict,
    mux_and_gpio,
    gpio_conflict,
    expander_line,
    no_such_pin,
    no_such_function,
    foreign_function,
    pin_twice,
    signal_twice,
    not_bonded,
)
