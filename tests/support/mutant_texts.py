"""Mutants of Python texts: one small change of a source text that a test should notice.

Cosmic-ray's operators can be used as a library, but they mutate annotations as well and no strings, and the package
brings a web server and a database. mutmut 3 rewrites whole modules for a runner of its own. So the operators are here.

What is changed: comparisons, arithmetic, `and`, `or`, `not`, numbers, `True`, `False`, and strings without a space.
What is not: annotations, docstrings, decorators, `__all__`, what only type checkers read, `assert`, `raise`, and what
is printed, warned or shown as help. A string with a space is a text for people.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

COMPARE = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "=="}
WORDS = {"is": "is not", "is not": "is", "in": "not in", "not in": "in", "and": "or", "or": "and"}
ARITHMETIC = {"+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "*", "**": "*", "<<": ">>", ">>": "<<"}
BITS = {"|": "&", "&": "|"}
AUGMENTED = {f"{before}=": f"{after}=" for before, after in {**ARITHMETIC, **BITS}.items()}
OPERATOR = re.compile(r"[-+*/%&|<>=!]+|and|or|not|(?:not )?in|is(?: not)?")
"""What of `Mutant.before` is no constant."""
REPLACED = {**COMPARE, **WORDS, **ARITHMETIC, **BITS, **AUGMENTED}

SHOWN = {"print", "say", "warn"}
"""Functions whose arguments are texts for people."""
HELP = {"help", "epilog", "metavar", "description", "title", "doc"}
"""Keywords whose values are."""
GUARDS = {"strict"}
"""Keywords that matter only where a call is wrong: `zip(a, b, strict=True)`."""
NAMES = {"TypeVar", "cast", "NewType", "NamedTuple", "namedtuple", "ParamSpec", "check"}
"""Functions whose strings repeat a name or a type: `check(code, "vkMapMemory")` names the call in its error."""
STRING = re.compile(r"""(['"])([^\s\\'"{}]*)\1""")
SKIPPED = (ast.Assert, ast.Raise, ast.Import, ast.ImportFrom, ast.JoinedStr)

Place = tuple[int, int]
"""A line, from 1, and a column in characters, from 0."""


@dataclass(frozen=True)
class Mutant:
    """One change of a file: `before`, which begins at `line` and `column`, becomes `after`."""

    file: str
    line: int
    column: int
    before: str
    after: str
    span: tuple[int, int]
    """The first and the last line of the statement, of a compound one without its body."""
    function: tuple[int, int] | None
    """The lines of the body of the function that it is in; None for what runs at import."""
    uses: frozenset[int] = field(default_factory=frozenset)
    """For what runs at import: the lines in functions of the same file that use its value, where these are known."""

    @property
    def change(self) -> str:
        """The change in a few characters: "< → <="."""
        return f"{self.before} → {self.after or 'nothing'}"


def applied(text: str, mutant: Mutant) -> str:
    """Return the text with the change; raise ValueError where the text is another one."""
    lines = text.splitlines(keepends=True)
    line = lines[mutant.line - 1]
    if not line.startswith(mutant.before, mutant.column):
        raise ValueError(f"{mutant.file}:{mutant.line} does not have {mutant.before!r} at {mutant.column}")
    rest = line[mutant.column + len(mutant.before) :]
    lines[mutant.line - 1] = line[: mutant.column] + mutant.after + (rest if mutant.after else rest.lstrip())
    return "".join(lines)


def mutants(text: str, file: str) -> list[Mutant]:
    """Return all mutants of a Python text, in the order of the text, each of which is Python too."""
    finder = _Finder(text, file)
    finder.visit(ast.parse(text))
    return sorted(
        (one for one in finder.found if _compiles(text, one)), key=lambda one: (one.line, one.column)
    )


def _compiles(text: str, mutant: Mutant) -> bool:
    """Whether a change without an operand's sign or `not` still reads as Python; others always do."""
    if mutant.after:
        return True
    try:
        ast.parse(applied(text, mutant))
    except SyntaxError:
        return False
    return True


class _Finder(ast.NodeVisitor):
    """Collects the mutants of a syntax tree; `visit` is given the whole module."""

    def __init__(self, text: str, file: str) -> None:
        self.found: list[Mutant] = []
        self._file = file
        self._lines = text.splitlines(keepends=True)
        skipped = {tokenize.NL, tokenize.NEWLINE, tokenize.COMMENT, tokenize.INDENT, tokenize.DEDENT}
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        self._tokens = [one for one in tokens if one.type not in skipped]
        self._starts = [one.start for one in self._tokens]
        self._span = (1, 1)
        self._function: tuple[int, int] | None = None
        self._uses: frozenset[int] = frozenset()
        self._names: dict[str, set[int]] = {}

    # --- what is not mutated, and where a statement lies --------------------------------------------------------------

    def visit(self, node: ast.AST) -> None:
        if isinstance(node, SKIPPED) or _is_apart(node):
            return
        if isinstance(node, ast.stmt):
            before = self._span
            self._span = _span(node)
            super().visit(node)
            self._span = before
        else:
            super().visit(node)

    def visit_Module(self, node: ast.Module) -> None:
        for function in (one for one in ast.walk(node) if isinstance(one, ast.FunctionDef)):
            for name in (
                one for part in function.body for one in ast.walk(part) if isinstance(one, ast.Name)
            ):
                self._names.setdefault(name.id, set()).add(name.lineno)
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        if "TYPE_CHECKING" in ast.dump(node.test):
            for one in node.orelse:
                self.visit(one)
            return
        self.generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef | ast.AsyncFunctionDef) -> None:
        span = (node.body[0].lineno, node.end_lineno or node.body[-1].lineno)
        outside, uses = self._function, self._uses
        if outside is None:
            self._uses = frozenset(range(span[0], span[1] + 1))
        for default in (*node.args.defaults, *node.args.kw_defaults):
            if default is not None:
                self.visit(default)
        self._function, self._uses = span, frozenset()
        for one in node.body:
            self.visit(one)
        self._function, self._uses = outside, uses

    visit_AsyncFunctionDef = visit_FunctionDef

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for one in node.body:
            self.visit(one)

    def visit_Lambda(self, node: ast.Lambda) -> None:
        self.visit(node.body)

    def visit_Assign(self, node: ast.Assign) -> None:
        before = self._uses
        if self._function is None:
            names = [target.id for target in node.targets if isinstance(target, ast.Name)]
            self._uses = frozenset(line for name in names for line in self._names.get(name, ()))
        self.generic_visit(node)
        self._uses = before

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit_Assign(ast.copy_location(ast.Assign(targets=[node.target], value=node.value), node))

    def visit_Call(self, node: ast.Call) -> None:
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        if name in SHOWN:
            return
        self.visit(node.func)
        for argument in node.args:
            if not (name in NAMES and isinstance(argument, ast.Constant)):
                self.visit(argument)
        for keyword in node.keywords:
            if keyword.arg not in HELP | GUARDS:
                self.visit(keyword.value)

    # --- what is ------------------------------------------------------------------------------------------------------

    def visit_Compare(self, node: ast.Compare) -> None:
        for left, right in pairwise([node.left, *node.comparators]):
            self._operator(left, right)
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        texts = any(
            isinstance(one, ast.JoinedStr) or (isinstance(one, ast.Constant) and isinstance(one.value, str))
            for one in (node.left, node.right)
        )
        # A union of types at import reads as one of flags does.
        bits = isinstance(node.op, ast.BitOr | ast.BitAnd)
        if not texts and not (bits and self._function is None):
            self._operator(node.left, node.right)
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        for left, right in pairwise(node.values):
            self._operator(left, right)
        self.generic_visit(node)

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        self._operator(node.target, node.value)
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        dropped = {ast.Not: "not", ast.USub: "-"}.get(type(node.op))
        if dropped and not isinstance(node.operand, ast.Constant):
            self._add(self._place(node.lineno, node.col_offset), dropped, "")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        tokens = list(self._between(_start(self, node), _end(self, node)))
        if len(tokens) == 1 and (after := other(tokens[0].string, node.value)):
            self._add(tokens[0].start, tokens[0].string, after)

    def visit_MatchValue(self, node: ast.MatchValue) -> None:
        self.visit(node.value)

    def _operator(self, left: ast.expr, right: ast.expr) -> None:
        """Add the mutant of the operator between two operands."""
        tokens = [
            one for one in self._between(_end(self, left), _start(self, right)) if one.string not in "()"
        ]
        before = " ".join(one.string for one in tokens)
        if before in REPLACED and len({one.start[0] for one in tokens}) == 1:
            written = self._lines[tokens[0].start[0] - 1][tokens[0].start[1] : tokens[-1].end[1]]
            self._add(tokens[0].start, written, REPLACED[before])

    def _between(self, first: Place, last: Place) -> Iterator[tokenize.TokenInfo]:
        for token in self._tokens[bisect_left(self._starts, first) :]:
            if token.start >= last:
                return
            yield token

    def _place(self, line: int, offset: int) -> Place:
        """Return a place as tokens have it: the syntax tree counts bytes."""
        return line, len(self._lines[line - 1].encode()[:offset].decode())

    def _add(self, place: Place, before: str, after: str) -> None:
        self.found.append(Mutant(self._file, *place, before, after, self._span, self._function, self._uses))


def other(written: str, value: object) -> str:
    """Return another constant for the one that is written so, "" where there is none."""
    if isinstance(value, bool):
        return str(not value)
    if isinstance(value, int):
        bases = {"0x": hex, "0b": bin, "0o": oct}
        return bases.get(written[:2].lower(), str)(value + 1)
    if isinstance(value, float):
        return repr(2.0 * value) if value else "1.0"
    if isinstance(value, str) and (found := STRING.fullmatch(written)):
        return f"{found[1]}{found[2]}_{found[1]}"
    return ""


def _is_apart(node: ast.AST) -> bool:
    """Whether a node is a docstring, `__all__`, or what runs for `python -m` alone."""
    if isinstance(node, ast.Expr):
        return isinstance(node.value, ast.Constant)
    if isinstance(node, ast.Assign):
        return any(getattr(target, "id", "") == "__all__" for target in node.targets)
    return isinstance(node, ast.If) and "'__name__'" in ast.dump(node.test)


def _span(node: ast.stmt) -> tuple[int, int]:
    """Return the lines of a statement without the statements in it."""
    body = getattr(node, "body", None) or getattr(node, "cases", None)
    last = node.end_lineno or node.lineno
    if body:
        first = body[0].pattern.lineno if isinstance(body[0], ast.match_case) else body[0].lineno
        last = max(node.lineno, first - 1)
    return node.lineno, last


def _start(finder: _Finder, node: ast.expr) -> Place:
    return finder._place(node.lineno, node.col_offset)


def _end(finder: _Finder, node: ast.expr) -> Place:
    return finder._place(node.end_lineno or node.lineno, node.end_col_offset or 0)
