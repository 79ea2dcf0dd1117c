# SPDX-License-Identifier: GPL-3.0-or-later
"""What rtud --check says of random nets, judged by SNAKES, a Petri-net library that knows nothing of ours."""

import json
import random
import re
import subprocess
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from snakes.data import Substitution
from snakes.nets import Inhibitor, Marking, MultiArc, PetriNet, Place, Transition, Value, dot

pytestmark = pytest.mark.slow

NETS = 60
STATES_MAX = 80  # that the judge looks at
MODULES = ("a", "b", "c")


@dataclass
class Net:
    """A part "net" of a configuration, and the same in SNAKES."""

    part: dict[str, Any]
    judge: PetriNet
    has_inhibitors: bool = False
    begins: dict[str, str] = field(default_factory=dict)  # by module

    @property
    def initial(self) -> Marking:
        return self.judge.get_marking()


def tokens(weight: int) -> Any:
    return Value(dot) if weight == 1 else MultiArc([Value(dot)] * weight)


def add_arc(net: Net, place: str, transition: str, kind: str, weight: int) -> None:
    """As the configuration has it, and as SNAKES has it."""
    arcs = net.part["arcs"]
    if kind == "unless":
        arcs.append(f"{place} -(0)-> {transition}")
        net.judge.add_input(place, transition, Inhibitor(Value(dot)))
        net.has_inhibitors = True
    elif kind == "takes":
        arcs.append(f"{place} -({weight})-> {transition}")
        net.judge.add_input(place, transition, tokens(weight))
    else:
        arcs.append(f"{transition} -({weight})-> {place}")
        net.judge.add_output(place, transition, tokens(weight))


def add_turns(net: Net, module: dict[str, Any]) -> None:
    """A module begins a scan, fires its points in it, and ends it."""
    name = module["name"]
    if "scan_begin" not in module:
        return
    net.begins[name] = module["scan_begin"]
    if not module["points"] and "scan_end" not in module:
        return
    waits, scans, quiet = f"{name} waits", f"{name} scans", f"{name} ends its scan"
    net.judge.add_place(Place(waits, [dot]))
    net.judge.add_place(Place(scans, []))
    if "scan_end" not in module:
        net.judge.add_transition(Transition(quiet))
    end = module.get("scan_end", quiet)
    pairs = [(waits, module["scan_begin"], scans), (scans, end, waits)]
    pairs += [(scans, point["transition"], scans) for point in module["points"]]
    for before, transition, after in pairs:
        net.judge.add_input(before, transition, Value(dot))
        net.judge.add_output(after, transition, Value(dot))


def random_net(source: random.Random) -> Net:
    places = [{"name": f"p{i}", "tokens": source.choice([0, 0, 1, 2])} for i in range(source.randint(1, 4))]
    net = Net({"places": places, "transitions": [], "arcs": [], "modules": []}, PetriNet("net"))
    for place in places:
        net.judge.add_place(Place(place["name"], [dot] * place["tokens"]))
    for name in MODULES[: source.randint(1, 3)]:
        module: dict[str, Any] = {"name": name, "points": []}
        for hook in ("scan_begin", "scan_end"):
            if source.random() < 0.7:
                module[hook] = f"{name}.{hook}"
                net.part["transitions"].append(module[hook])
        for point in range(source.randint(0, 2)):
            net.part["transitions"].append(f"{name}.point{point}")
            module["points"].append({"name": str(point), "transition": f"{name}.point{point}"})
        net.part["modules"].append(module)
    inhibitors = source.random() < 0.3
    for transition in net.part["transitions"]:
        net.judge.add_transition(Transition(transition))
        for place in places:
            kinds = ["none"] * 4 + ["takes"] * 3 + ["gives"] + ["unless"] * inhibitors
            kind = source.choice(kinds)
            if kind != "none":
                add_arc(net, place["name"], transition, kind, source.choice([1, 1, 1, 2]))
            if kind == "takes" and source.random() < 0.3:
                add_arc(net, place["name"], transition, "gives", 1)
    for module in net.part["modules"]:
        add_turns(net, module)
    return net


@dataclass
class Judgement:
    """All markings, or the first STATES_MAX of them."""

    complete: bool = True
    depth: dict[Marking, int] = field(default_factory=dict)
    successors: dict[Marking, dict[str, Marking]] = field(default_factory=dict)
    grows: bool = False  # some marking is greater than one that leads to it

    @property
    def deadlock(self) -> int | None:
        """Firings of the shortest way into one."""
        return min((self.depth[at] for at, after in self.successors.items() if not after), default=None)

    def stuck(self, transition: str) -> int | None:
        """Firings of the shortest way to a marking after which it never fires."""
        can = {at for at, after in self.successors.items() if transition in after}
        grew = True
        while grew:
            more = {at for at, after in self.successors.items() if at not in can and can & {*after.values()}}
            can |= more
            grew = bool(more)
        return min((self.depth[at] for at in self.successors if at not in can), default=None)


def fire(net: Net, marking: Marking, transition: Transition) -> Marking | None:
    net.judge.set_marking(marking)
    if not transition.enabled(Substitution()):
        return None
    transition.fire(Substitution())
    return net.judge.get_marking()


def judge(net: Net) -> Judgement:
    initial = net.initial
    judgement = Judgement(depth={initial: 0})
    parents: dict[Marking, Marking | None] = {initial: None}
    todo = [initial]
    for marking in todo:
        if judgement.grows:  # without end: SNAKES takes long for many tokens
            judgement.complete = False
            break
        judgement.successors[marking] = {}
        for transition in net.judge.transition():
            after = fire(net, marking, transition)
            if after is None:
                continue
            judgement.successors[marking][transition.name] = after
            if after in judgement.depth:
                continue
            if len(todo) == STATES_MAX:
                judgement.complete = False
                continue
            parents[after] = marking
            judgement.depth[after] = judgement.depth[marking] + 1
            todo.append(after)
            ancestor: Marking | None = marking
            while ancestor is not None:
                judgement.grows |= after > ancestor
                ancestor = parents[ancestor]
    return judgement


def says(programs: Path, directory: Path, net: Net) -> str:
    modules = [{"name": name, "program": f"/{name}"} for name in MODULES]
    file = directory / "gateway.json"
    file.write_text(json.dumps({"port": [], "modules": modules, "net": net.part}))
    done = subprocess.run(
        [programs / "rtud/rtud", "--check", file], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def sequence(net: Net, text: str, what: str) -> list[str] | None:
    """The sequence that leads there; SNAKES can fire it."""
    found = re.search(rf"^net: {re.escape(what)}(?: after (.*)| at the start)$", text, re.MULTILINE)
    if found is None:
        return None
    fired = found[1].split(", ") if found[1] else []
    marking: Marking | None = net.initial
    for name in fired:
        assert marking is not None
        marking = fire(net, marking, net.judge.transition(name))
    assert marking is not None, f"{what}: {fired} cannot fire"
    net.judge.set_marking(marking)
    return fired


@pytest.mark.parametrize("seed", range(NETS))
def test_check_is_right(programs: Path, tmp_path: Path, seed: int) -> None:
    net = random_net(random.Random(seed))
    initial = net.initial
    judgement = judge(net)
    net.judge.set_marking(initial)
    text = says(programs, tmp_path, net)
    if judgement.grows and not net.has_inhibitors:
        assert "net: not bounded: place" in text
    if not judgement.complete:
        return
    assert f"all {len(judgement.depth)} markings looked at" in text
    counts = [len(marking(place)) for marking in judgement.depth for place in marking if " " not in place]
    most = max(counts, default=0)
    assert f"net: bounded: at most {most} token" in text
    fires = {name for after in judgement.successors.values() for name in after}
    dead = set(re.findall(r'^net: dead: transition "(.*)" can never fire$', text, re.MULTILINE))
    assert dead == set(net.part["transitions"]) - fires
    idle = set(re.findall(r'^net: "(.*)" can never run', text, re.MULTILINE))
    assert idle == {name for name, begin in net.begins.items() if begin not in fires}
    fired = sequence(net, text, "deadlock")
    assert (None if fired is None else len(fired)) == judgement.deadlock
    if fired is not None:
        assert not any(transition.enabled(Substitution()) for transition in net.judge.transition())
        return
    for name, begin in net.begins.items():
        net.judge.set_marking(initial)
        fired = sequence(net, text, f'"{name}" stops for good')
        expected = judgement.stuck(begin) if begin in fires else None
        assert (None if fired is None else len(fired)) == expected


def test_nets_are_of_all_sorts() -> None:
    """The judge has something to judge in each of its questions."""
    nets = [random_net(random.Random(seed)) for seed in range(NETS)]
    judgements = [judge(net) for net in nets]
    assert sum(judgement.complete for judgement in judgements) > NETS // 4
    assert sum(judgement.grows for judgement in judgements) > NETS // 10
    complete = [judgement for judgement in judgements if judgement.complete]
    assert sum((judgement.deadlock or 0) > 1 for judgement in complete) > NETS // 10
    assert sum(judgement.deadlock is None for judgement in complete) > 5
