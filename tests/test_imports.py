"""Imports between the modules of palpate: no circles, and none from a room above its own in docs/design.md's table."""

import ast
import re
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src"


def modules() -> dict[str, Path]:
    """Return the files of all modules by name; that of a package is its `__init__.py`."""
    found = {}
    for path in (SOURCE / "palpate").rglob("*.py"):
        name = ".".join(path.relative_to(SOURCE).with_suffix("").parts)
        found[name.removesuffix(".__init__")] = path
    return found


MODULES = modules()


def public_names() -> dict[str, str]:
    """Return the module of each name that `palpate` imports when it is first used, from `__init__.pyi`."""
    stub = ast.parse((SOURCE / "palpate/__init__.pyi").read_text())
    imports = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return {name.name: f"palpate.{node.module}" for node in imports for name in node.names}


PUBLIC = public_names()


def statements(node: ast.AST) -> Iterator[ast.AST]:
    """Yield a node and all in it, also in functions, without blocks for type checkers, which do not run."""
    if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
        return
    yield node
    for child in ast.iter_child_nodes(node):
        yield from statements(child)


def names_in(node: ast.AST) -> list[str]:
    """Return the modules, or names in modules, that a node imports: `palpate.Tracker` of a lazy name counts, too."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.module:
        assert not node.level, "an import is relative; these tests read absolute ones"
        return [f"{node.module}.{alias.name}" for alias in node.names]
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "palpate":
        return [f"palpate.{node.attr}"]
    if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith("palpate."):
        return [node.value]  # of import_module
    return []


def imported_by(name: str) -> set[str]:
    """Return the modules that a module imports, and their packages, which Python imports before them."""
    found = set()
    for node in statements(ast.parse(MODULES[name].read_text())):
        for target in names_in(node):
            package, _, last = target.rpartition(".")
            module = PUBLIC.get(last, target) if package == "palpate" else target
            module = module if module in MODULES else module.rpartition(".")[0]
            while module in MODULES and module != "palpate":
                if not name.startswith(f"{module}."):
                    found.add(module)
                module = module.rpartition(".")[0]
    return found - {name}


GRAPH = {name: imported_by(name) for name in MODULES}


def rows_of_rooms() -> dict[str, int]:
    """Return the row of each room in the table of docs/design.md."""
    text = (ROOT / "docs/design.md").read_text()
    table = text.partition("| room | content |\n|---|---|\n")[2].partition("\n\n")[0]
    first_cells = [line.split("|")[1] for line in table.splitlines()]
    return {room: row for row, cell in enumerate(first_cells) for room in re.findall(r"`(\w+)/?`", cell)}


def room_of(module: str) -> str:
    return module.split(".")[1]


def test_the_graph_is_that_of_the_package():
    """Imports of each kind are seen: of a module, of a name, in a function, of a lazy name."""
    assert "palpate.types.measurements" in GRAPH["palpate.tracker"]
    assert "palpate.errors" in GRAPH["palpate.config"]
    assert "palpate.live.session" in GRAPH["palpate.cli.track"]
    assert "palpate.touch.touch_model" in GRAPH["palpate.cli.options"]
    assert "palpate.touch.calibration" not in GRAPH["palpate.types.sensor"]


def test_no_module_imports_itself_through_others():
    try:
        TopologicalSorter(GRAPH).prepare()
    except CycleError as error:
        raise AssertionError(f"a circle of imports: {' - '.join(error.args[1])}") from None


def test_every_room_is_in_the_table():
    rooms = {room_of(module) for module in MODULES if module != "palpate"}
    assert rooms == rows_of_rooms().keys()


def test_imports_go_up_the_table_of_rooms_only():
    row = rows_of_rooms()
    wrong = [
        f"{module} imports {target}"
        for module, targets in GRAPH.items()
        for target in targets
        if module != "palpate" and row[room_of(target)] > row[room_of(module)]
    ]
    assert not wrong
