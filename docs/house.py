"""Draws the rooms of `src/pourcast` and who imports whom, from the imports themselves.

    python docs/house.py

prints the drawing in CONTRIBUTING.md (Mermaid); a test holds it current. An arrow that follows from
two others is left out.
"""

import sys
from graphlib import TopologicalSorter
from itertools import permutations

import grimp

APART = ("networks.training",)
"""Rooms in rooms that stand elsewhere in the house."""

GROUND = (
    "cores",
    "errors",
    "extras",
    "files",
    "frozen",
    "numbers",
    "progress",
    "registry",
    "spreadsheets",
    "tables",
)
"""Single files that everybody may use: the ground floor."""


def room_of(module: str) -> str:
    """The room that a module stands in; empty for the package itself."""
    name = module.removeprefix("pourcast").removeprefix(".")
    for room in APART:
        if name == room or name.startswith(f"{room}."):
            return room
    top = name.partition(".")[0]
    if top in GROUND:
        return "ground floor"
    return "" if top == "__main__" else top


def arrows() -> dict[str, set[str]]:
    """Room -> rooms that it imports."""
    graph = grimp.build_graph("pourcast")
    found: dict[str, set[str]] = {}
    for module in graph.modules:
        room = room_of(module)
        others = {room_of(other) for other in graph.find_modules_directly_imported_by(module)}
        found.setdefault(room, set()).update(others - {room, ""})
    found.pop("", None)
    return found


def reduced(found: dict[str, set[str]]) -> dict[str, set[str]]:
    """The same without arrows that follow from others; raises `CycleError` if there is a circle."""
    below: dict[str, set[str]] = {}
    for room in TopologicalSorter(found).static_order():
        below[room] = found.get(room, set()).union(*(below[other] for other in found.get(room, ())))
    kept = {room: set(others) for room, others in found.items()}
    for room, others in found.items():
        for near, far in permutations(others, 2):
            if far in below[near]:
                kept[room].discard(far)
    return kept


def drawing() -> str:
    """The drawing, in Mermaid."""
    kept = reduced(arrows())
    lines = ["flowchart TD"]
    lines += [
        f"    {_node(room)} --> {_node(other)}"
        for room in sorted(kept)
        for other in sorted(kept[room])
    ]
    return "\n".join(lines) + "\n"


def _node(room: str) -> str:
    return f"{room.replace('.', '_').replace(' ', '_')}[{room.replace('.', '/')}]"


if __name__ == "__main__":
    sys.stdout.write(drawing())
