"""Plainness of the code against limits: `python scripts/check_plainness.py`, part of `make lint`.

Each measure counts what makes code harder to read than it need be, in palpate and in its laboratory, each by itself.
There is no limit on size: one more line that reads at once is better than a line that is read twice. Exit code 1 says
that a limit is exceeded; places that count are listed.
"""

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
DISTRIBUTIONS = ("src/palpate", "lab/src/palpate_lab")
LIMITS = {
    "tuple assignments per 1000 code lines": 8,
    "tuple assignments per 1000 code lines, worst room": 15,
    "percent of functions above 40 lines": 3,
    "longest function, lines": 80,
    "functions of more than 8 arguments": 6,
    "constants of config that one other file alone uses": 8,
    "numeric module constants": 130,
    "docstrings that open with a question word": 10,
}
INNER_TESTS = "share of test lines in files that import inner modules"
INNER_TESTS_LIMIT = 0.4
LONG_FUNCTION = 40
MANY_ARGUMENTS = 8
SHOWN = 20
"""Places that are listed for a measure."""
SMALL_ROOM = 300
"""A room of fewer code lines counts as one of so many; a single assignment would make it the worst."""
QUESTION = re.compile(r"(?:Return )?(what|whether|how|where|why)\b", re.IGNORECASE)
INNER_IMPORT = re.compile(r"^\s*(from palpate\.[\w.]+ import|import palpate\.\w)", re.MULTILINE)
CONSTANT_NAME = re.compile(r"\b[A-Z][A-Z_0-9]+\b")

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Source:
    """A Python file of a distribution."""

    name: str
    """Path from the root of the repository."""
    room: str
    """Folder in the package, or "top" for a file directly in it."""
    text: str
    tree: ast.Module

    def places(self, kind: type[ast.AST] | tuple[type[ast.AST], ...]) -> Iterator[tuple[str, ast.AST]]:
        """Yield the syntax nodes of a kind, each with file and line."""
        for node in ast.walk(self.tree):
            if isinstance(node, kind):
                yield f"{self.name}:{getattr(node, 'lineno', 1)}", node

    def functions(self) -> Iterator[tuple[str, Function]]:
        """Yield the functions, each with file, line and name."""
        for place, node in self.places((ast.FunctionDef, ast.AsyncFunctionDef)):
            assert isinstance(node, Function)
            yield f"{place} {node.name}", node


@dataclass(frozen=True)
class Measure:
    """One measure of a distribution."""

    name: str
    value: float
    limit: float
    places: list[str]
    """What counts, with files and lines."""

    @property
    def is_exceeded(self) -> bool:
        """True if the value is above the limit."""
        return self.value > self.limit

    def print(self) -> None:
        """Print value and limit and, where the limit is exceeded, the first places."""
        print(f"  {self.name:58s} {self.value:6g}  limit {self.limit:4g}{'  EXCEEDED' if self.is_exceeded else ''}")
        if self.is_exceeded:
            print(*(f"      {place}" for place in self.places[:SHOWN]), sep="\n")
            if len(self.places) > SHOWN:
                print(f"      and {len(self.places) - SHOWN} more")


def main() -> int:
    """Print all measures with their limits and return 1 if one is exceeded."""
    is_exceeded = False
    for package in DISTRIBUTIONS:
        print(package)
        for measure in measures(read_sources(package)):
            measure.print()
            is_exceeded |= measure.is_exceeded
    print("tests")
    inner = inner_tests()
    inner.print()
    return int(is_exceeded or inner.is_exceeded)


def read_sources(package: str) -> list[Source]:
    """Return the Python files of a package, sorted by name."""
    sources = []
    for path in sorted((ROOT / package).rglob("*.py*")):
        if path.suffix not in (".py", ".pyi"):
            continue
        parents = path.relative_to(ROOT / package).parts[:-1]
        text = path.read_text(encoding="utf-8")
        room = parents[0] if parents else "top"
        sources.append(Source(path.relative_to(ROOT).as_posix(), room, text, ast.parse(text)))
    return sources


def measures(sources: list[Source]) -> list[Measure]:
    """Return all measures of a package."""
    functions = [function for source in sources for function in source.functions()]
    # What `make kernels` writes is as long as the model has variables.
    written = [(place, function) for place, function in functions if "/models/generated" not in place]
    lengths = {place: code_length(function) for place, function in written}
    long = sorted(place for place, length in lengths.items() if length > LONG_FUNCTION)
    longest = max(lengths, key=lambda place: lengths[place])
    wide = [place for place, function in functions if argument_count(function) > MANY_ARGUMENTS]
    counted = [
        *tuple_assignments(sources),
        (round(100 * len(long) / len(functions), 1), long),
        (lengths[longest], [longest]),
        (len(wide), wide),
        as_count(constants_of_one_user(sources)),
        as_count(numeric_constants(sources)),
        as_count(question_docstrings(sources)),
    ]
    return [
        Measure(name, value, limit, places)
        for (name, limit), (value, places) in zip(LIMITS.items(), counted, strict=True)
    ]


def as_count(places: list[str]) -> tuple[int, list[str]]:
    """Return a number of places, and the places."""
    return len(places), places


def tuple_assignments(sources: list[Source]) -> list[tuple[float, list[str]]]:
    """Return assignments such as `a, b = x, y` per 1000 code lines, of the package and of its worst room."""
    places: dict[str, list[str]] = {}
    code_lines: Counter[str] = Counter()
    for source in sources:
        code_lines[source.room] += count_code_lines(source.text)
        found = places.setdefault(source.room, [])
        for place, node in source.places(ast.Assign):
            assert isinstance(node, ast.Assign)
            if isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Tuple):
                found.append(place)
    shares = {room: 1000 * len(found) / max(code_lines[room], SMALL_ROOM) for room, found in places.items()}
    worst = max(shares, key=lambda room: shares[room])
    everywhere = [place for found in places.values() for place in found]
    overall = round(1000 * len(everywhere) / code_lines.total())
    return [(overall, everywhere), (round(shares[worst]), places[worst])]


def count_code_lines(text: str) -> int:
    """Return the number of lines that are neither empty nor a comment alone."""
    return sum(bool(line.strip()) and not line.strip().startswith("#") for line in text.splitlines())


def code_length(function: Function) -> int:
    """Return the number of lines of a function without its docstring and decorators."""
    assert function.end_lineno is not None
    length = function.end_lineno - function.lineno + 1
    if ast.get_docstring(function) is None:
        return length
    docstring = function.body[0]
    assert docstring.end_lineno is not None
    return length - (docstring.end_lineno - docstring.lineno + 1)


def argument_count(function: Function) -> int:
    """Return the number of arguments of a function, without self."""
    arguments = [*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs]
    return sum(argument.arg not in ("self", "cls") for argument in arguments)


def constants_of_one_user(sources: list[Source]) -> list[str]:
    """Return the constants of config.py that exactly one other file uses; they belong there."""
    configs = [source for source in sources if source.name.endswith("/config.py")]
    users = {source.name: set(CONSTANT_NAME.findall(source.text)) for source in sources if source not in configs}
    found = []
    for config in configs:
        for name in assigned_names(config.tree):
            files = [file for file, names in users.items() if name in names]
            if CONSTANT_NAME.fullmatch(name) and len(files) == 1:
                found.append(f"{name}, used by {files[0]}")
    return found


def assigned_names(module: ast.Module) -> list[str]:
    """Return the names assigned at the level of a module."""
    names = []
    for node in module.body:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            inside = [each for each in ast.walk(node) if isinstance(each, ast.Name)]
            names += [each.id for each in inside if isinstance(each.ctx, ast.Store)]
    return names


def numeric_constants(sources: list[Source]) -> list[str]:
    """Return the names at module level that are numbers or tuples of numbers."""
    found = []
    for source in sources:
        for node in source.tree.body:
            if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and is_number(node.value):
                module = ast.Module([node], [])
                found += [f"{source.name}:{node.lineno} {name}" for name in assigned_names(module)]
    return found


def is_number(node: ast.expr) -> bool:
    """Return True if an expression is a number, or a tuple or arithmetic of numbers."""
    match node:
        case ast.Constant():
            return isinstance(node.value, int | float) and not isinstance(node.value, bool)
        case ast.UnaryOp():
            return is_number(node.operand)
        case ast.BinOp():
            return is_number(node.left) and is_number(node.right)
        case ast.Tuple():
            return bool(node.elts) and all(map(is_number, node.elts))
    return False


def question_docstrings(sources: list[Source]) -> list[str]:
    """Return the places of docstrings that open with a question word."""
    found = []
    for source in sources:
        for place, node in source.places((ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef, ast.Module)):
            assert isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef | ast.Module)
            if QUESTION.match(ast.get_docstring(node) or ""):
                found.append(place)
    return found


def inner_tests() -> Measure:
    """Return the share of test lines in files that import modules which palpate does not name in public."""
    texts = {path: path.read_text(encoding="utf-8") for path in sorted((ROOT / "tests").rglob("*.py"))}
    inner = [path for path, text in texts.items() if INNER_IMPORT.search(text)]
    lines = sum(text.count("\n") for text in texts.values())
    inner_lines = sum(texts[path].count("\n") for path in inner)
    share = round(inner_lines / lines, 2)
    return Measure(INNER_TESTS, share, INNER_TESTS_LIMIT, [path.relative_to(ROOT).as_posix() for path in inner])


if __name__ == "__main__":
    sys.exit(main())
