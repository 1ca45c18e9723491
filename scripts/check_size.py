"""Size and plainness of the package against their budgets: `python scripts/check_size.py`, part of `make lint`.

Exit code 1 names what has outgrown its budget. Where the goal is not reached yet, the budget is what has been reached:
it falls with every deletion, and is raised only with a reason in the commit that raises it.
"""

import ast
import re
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
BUDGETS = {
    "lines of the product": 12000,
    "lines of the laboratory": 6000,  # goal 6000
    "files in src": 122,
    "lines of tests": 14400,
    "lines of scripts and benchmarks": 2500,
    "words of docs": 18000,
    "numeric module constants": 121,
    "docstrings that open with a question word": 6,
    "percent of test lines in files that import inner modules": 42,
}
SUFFIXES = {".py", ".pyi", ".j2", ".js", ".sh", ".md"}
QUESTION = re.compile(r"(?:Return )?(what|whether|how|where|why)\b", re.IGNORECASE)
INNER_IMPORT = re.compile(r"^\s*(from palpate\.[\w.]+ import|import palpate\.\w)", re.MULTILINE)


def main() -> int:
    """Print all sizes with their budgets and return 1 if one is exceeded."""
    found = sizes()
    for name, size in found.items():
        print(f"{name:58s} {size:6d}  budget {BUDGETS[name]:6d}{'  EXCEEDED' if size > BUDGETS[name] else ''}")
    return int(any(size > BUDGETS[name] for name, size in found.items()))


def sizes() -> dict[str, int]:
    """Return the sizes of the files in the repository."""
    folders = ("src", "tests", "scripts", "benchmarks", "docs")
    found = (path for folder in folders for path in (ROOT / folder).rglob("*") if path.suffix in SUFFIXES)
    text = {path.relative_to(ROOT).as_posix(): path.read_text(errors="replace") for path in found}
    source = [name for name in text if name.startswith("src/") and name.endswith((".py", ".pyi", ".j2", ".js"))]
    laboratory = [name for name in source if name.startswith("src/palpate/lab/")]
    tests = [name for name in text if name.startswith("tests/") and name.endswith(".py")]
    tools = [name for name in text if name.startswith(("scripts/", "benchmarks/")) and name.endswith((".py", ".sh"))]
    trees = [ast.parse(text[name]) for name in source if name.endswith(".py")]

    def lines(names: list[str]) -> int:
        return sum(text[name].count("\n") for name in names)

    return {
        "lines of the product": lines(source) - lines(laboratory),
        "lines of the laboratory": lines(laboratory),
        "files in src": len(source),
        "lines of tests": lines(tests),
        "lines of scripts and benchmarks": lines(tools),
        "words of docs": sum(len(text[name].split()) for name in text if re.match(r"docs/.*\.md$", name)),
        "numeric module constants": sum(map(constants, trees)),
        "docstrings that open with a question word": sum(map(questions, trees)),
        "percent of test lines in files that import inner modules": round(
            100 * lines([name for name in tests if INNER_IMPORT.search(text[name])]) / max(lines(tests), 1)
        ),
    }


def constants(module: ast.Module) -> int:
    """Return the number of names at module level that are numbers or tuples of numbers."""
    count = 0
    for node in module.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value is not None and is_number(node.value):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            count += sum(len(one.elts) if isinstance(one, ast.Tuple) else 1 for one in targets)
    return count


def is_number(node: ast.expr) -> bool:
    """Return True if an expression is a number, or a tuple or arithmetic of numbers."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return is_number(node.left) and is_number(node.right)
    return isinstance(node, ast.Tuple) and bool(node.elts) and all(map(is_number, node.elts))


def questions(module: ast.Module) -> int:
    """Return the number of docstrings that open with a question word."""
    documented = (ast.FunctionDef, ast.ClassDef, ast.Module)
    found = [ast.get_docstring(node) or "" for node in ast.walk(module) if isinstance(node, documented)]
    return sum(bool(QUESTION.match(docstring)) for docstring in found)


if __name__ == "__main__":
    sys.exit(main())
