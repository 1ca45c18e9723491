"""The chain of transforms that leads from one frame to another."""

from collections.abc import Callable, Mapping
from functools import reduce

from palpate.errors import FileError
from palpate.types.space import Placed


def chain(parents: Mapping[str, str], parent: str, child: str) -> tuple[list[str], list[str]]:
    """Return the frames on the way up from `parent`, and those from `child`, to the frame where both ways meet.

    `parents` has the parent of each frame; the frame where they meet is in neither. Raises FileError where there is
    no such frame.
    """
    if parent == child:
        raise FileError(f"{parent}:{child} is one frame, expected two")
    known = {*parents, *parents.values()}
    for name in (parent, child):
        if name not in known:
            raise FileError(f"no transform knows frame {name!r}; known are {', '.join(sorted(known)) or 'none'}")
    up_parent, up_child = _ancestors(parents, parent), _ancestors(parents, child)
    meeting = next((name for name in up_child if name in up_parent), None)
    if meeting is None:
        raise FileError(
            f"no chain of transforms leads from {parent!r} to {child!r}: {' < '.join(up_parent)} ends at "
            f"{up_parent[-1]!r}, {' < '.join(up_child)} at {up_child[-1]!r}"
        )
    return up_parent[: up_parent.index(meeting)], up_child[: up_child.index(meeting)]


def compose_chain(up_parent: list[str], up_child: list[str], placed: Callable[[str], Placed]) -> Placed:
    """Return parent_T_child of a `chain`; `placed` gives a frame's pose in its parent."""

    def from_meeting(names: list[str]) -> Placed:
        return reduce(lambda found, name: placed(name) @ found, names[1:], placed(names[0]))

    if not up_parent:
        return from_meeting(up_child)
    back = from_meeting(up_parent).inverse()
    return back @ from_meeting(up_child) if up_child else back


def single_chain(parents: Mapping[str, str]) -> tuple[str, str] | None:
    """Return the first and the last frame, if all transforms are one chain without a branch; None if not."""
    roots = set(parents.values()) - set(parents)
    leaves = set(parents) - set(parents.values())
    return (roots.pop(), leaves.pop()) if len(roots) == len(leaves) == 1 else None


def _ancestors(parents: Mapping[str, str], name: str) -> list[str]:
    """Return the frame, its parent, the parent of that, and so on."""
    names = [name]
    while (above := parents.get(names[-1])) is not None:
        if above in names:
            raise FileError(f"transforms run in a circle: {' < '.join([*names, above])}")
        names.append(above)
    return names
