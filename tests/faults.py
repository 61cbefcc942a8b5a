# SPDX-License-Identifier: MIT
"""Puts faults into a copy of the source, one at a time, and counts how many the tests find.

    .venv/bin/python tests/faults.py --list              # which fifty faults
    .venv/bin/python tests/faults.py                     # all, hours of processor time
    .venv/bin/python tests/faults.py mechanism fem:2     # those of a room; two of another one

A fault is a wrong sign, a wrong factor, an end that is off by one, a wrong index, or a term that is
left out. Each room has a fixed number, drawn at random from all that its functions could have, with
a fixed seed: the same source has the same faults. Only the tests of the room are run, up to the
first that fails. A fault that no test finds may also be none, as where a bound is any large number:
look at each.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
SOURCE = Path("src/dolfinx_ffr")
#: Faults of each room, and the tests that are to find them
ROOMS = {
    "body": (2, ["tests/body", "tests/dynamics/test_stiffened_markers.py"]),
    "boundary": (5, ["tests/boundary"]),
    "design": (5, ["tests/design"]),
    "dynamics": (10, ["tests/dynamics"]),
    "fem": (5, ["tests/fem", "tests/part/test_solid.py"]),
    "interchange": (2, ["tests/interchange"]),
    "mechanism": (4, ["tests/mechanism", "tests/dynamics/test_connections.py"]),
    "objective": (4, ["tests/objective", "tests/reduction/test_node_derivatives.py"]),
    "optimization": (4, ["tests/optimization"]),
    "part": (3, ["tests/part"]),
    "problem": (2, ["tests/test_problem.py", "tests/test_several_load_cases.py"]),
    "reduction": (4, ["tests/reduction"]),
}
#: Longest time of the tests for one fault [s]; a program that no longer ends has been found
LONGEST = 1800


@dataclass(frozen=True)
class Fault:
    """A change of one expression of a file."""

    kind: str  #: "sign", "factor", "off by one", "index" or "term left out"
    file: Path
    line: int  #: Of the expression
    before: str  #: Its text
    after: str  #: Its text with the fault
    span: tuple[int, int]  #: Of the text, in bytes from the beginning of the file


def faults_of(path: Path) -> Iterator[Fault]:
    """All faults that the functions of a file could have."""
    content = path.read_bytes()
    begins = [0]
    for line in content.splitlines(keepends=True):
        begins.append(begins[-1] + len(line))

    def text(node: ast.expr) -> str:
        first, last = span(node)
        return content[first:last].decode()

    def span(node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None and node.end_col_offset is not None
        first = begins[node.lineno - 1] + node.col_offset
        return first, begins[node.end_lineno - 1] + node.end_col_offset

    for node in expressions(ast.parse(content)):
        for kind, after in replacements(node, text):
            yield Fault(kind, path, node.lineno, text(node), after, span(node))


def expressions(tree: ast.Module) -> Iterator[ast.expr]:
    """The expressions of functions, without messages, type hints and default values."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                yield from _inside(statement)


def _inside(node: ast.AST) -> Iterator[ast.expr]:
    if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.FunctionDef | ast.AnnAssign):
        return
    if isinstance(node, ast.expr):
        yield node
    for child in ast.iter_child_nodes(node):
        yield from _inside(child)


def replacements(node: ast.expr, text: object) -> Iterator[tuple[str, str]]:
    """The kinds of faults of an expression, and its text with each."""
    assert callable(text)
    if isinstance(node, ast.BinOp):
        left, right = text(node.left), text(node.right)
        if isinstance(node.op, ast.Add | ast.Sub) and not _is_text(node):
            sign = "-" if isinstance(node.op, ast.Add) else "+"
            yield "sign", f"({left}) {sign} ({right})"
            yield "term left out", f"({left})"
        elif isinstance(node.op, ast.Mult | ast.Div) and isinstance(node.left, ast.Constant):
            if isinstance(node.left.value, float):
                yield "factor", f"2.0 * {text(node)}"
        elif isinstance(node.op, ast.Mult) and isinstance(node.right, ast.Name | ast.Attribute):
            yield "factor", f"({left})"
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        if not isinstance(node.operand, ast.Constant):
            yield "sign", f"({text(node.operand)})"
    elif isinstance(node, ast.Subscript):
        index = node.slice
        if isinstance(index, ast.Constant) and isinstance(index.value, int):
            yield "index", f"{text(node.value)}[{1 if index.value == 0 else 0}]"
        elif isinstance(index, ast.Slice) and isinstance(index.lower, ast.Constant):
            rest = text(node)[len(text(node.value)) :]
            number = str(index.lower.value)
            yield "off by one", text(node.value) + rest.replace(number, f"{number} + 1", 1)
    elif isinstance(node, ast.Call) and text(node.func) == "range" and len(node.args) == 1:
        yield "off by one", f"range(({text(node.args[0])}) - 1)"


def _is_text(node: ast.BinOp) -> bool:
    """Whether texts are joined."""
    return any(
        isinstance(part, ast.JoinedStr)
        or (isinstance(part, ast.Constant) and isinstance(part.value, str))
        for part in ast.walk(node)
    )


def chosen(room: str, count: int, tree: Path) -> list[Fault]:
    """The faults of a room in a tree: alike many of each kind."""
    possible: dict[str, list[Fault]] = {}
    for path in sorted((tree / SOURCE / room).rglob("*.py")):
        for fault in faults_of(path):
            possible.setdefault(fault.kind, []).append(fault)
    draw = random.Random(room)
    kinds = sorted(possible)
    draw.shuffle(kinds)
    return [draw.choice(possible[kinds[k % len(kinds)]]) for k in range(count)]


def copy_of_tree(folder: Path) -> None:
    """Copy all files that git knows into a folder, in the place of an earlier copy."""
    for part in ("src", "tests"):
        shutil.rmtree(folder / part, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files"], cwd=TOP, capture_output=True, text=True, check=True
    )
    for name in listed.stdout.splitlines():
        target = folder / name
        if (TOP / name).is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(TOP / name, target)


def outcome(fault: Fault, tests: list[str], folder: Path) -> str:
    """Which test finds a fault, or that none does."""
    content, times = fault.file.read_bytes(), fault.file.stat()
    first, last = fault.span
    fault.file.write_bytes(content[:first] + fault.after.encode() + content[last:])
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-n", "0", "-p", "no:cacheprovider"]
    environment = os.environ | {"PYTHONPATH": str(folder / "src")}
    try:
        done = subprocess.run(
            [*command, *tests],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            timeout=LONGEST,
        )
    except subprocess.TimeoutExpired:
        return f"found: not done in {LONGEST} s"
    finally:
        fault.file.write_bytes(content)
        os.utime(fault.file, ns=(times.st_atime_ns, times.st_mtime_ns))  # for compiled code
    if done.returncode == 0:
        return "NOT FOUND"
    failed = [line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return f"found: {failed[0].split(' - ')[0] if failed else done.stderr.strip()[-100:]}"


def main() -> None:
    """Run the tests with each of the faults that are asked for."""
    parser = argparse.ArgumentParser(description="Count the faults that the tests find.")
    parser.add_argument("rooms", nargs="*", default=list(ROOMS), help="as fem, or fem:2 for two")
    parser.add_argument("--list", action="store_true", help="say which faults, and run nothing")
    parser.add_argument("--fast", action="store_true", help="leave out the tests marked slow")
    parser.add_argument("--folder", type=Path, default=TOP / "build" / "faults", help="of the copy")
    given = parser.parse_args()
    tree = TOP if given.list else given.folder.resolve()
    if not given.list:
        copy_of_tree(tree)
    found = number = 0
    for word in given.rooms:
        room, _, few = word.partition(":")
        count, tests = ROOMS[room]
        selected = [*tests, "-m", "not slow"] if given.fast else tests
        for fault in chosen(room, count, tree)[: int(few or count)]:
            place = f"{fault.file.relative_to(tree)}:{fault.line}"
            print(f"{place} {fault.kind}: {fault.before!r} -> {fault.after!r}")
            if given.list:
                continue
            began = time.monotonic()
            said = outcome(fault, selected, tree)
            number += 1
            found += said.startswith("found")
            print(f"    {said} ({time.monotonic() - began:.0f} s)", flush=True)
    if number:
        print(f"{found} of {number} faults were found")


if __name__ == "__main__":
    main()
