# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the places of a C++ source that can be mutated, with libclang (python3-clang-14).

find_places(source, files, arguments) parses a source and returns, for the source and the headers in `files`, what can be replaced:
a schema holds the original and the mutated code, and deform_mutant::on(@) chooses between them when the program runs (@ is the number
of the mutant, filled in later).
"""
import dataclasses
import re

from clang import cindex
from clang.cindex import CursorKind as Kind
from clang.cindex import TypeKind

COMPARISONS = {"<": ["<=", ">="], "<=": ["<", ">"], ">": [">=", "<="], ">=": [">", "<"], "==": ["!="], "!=": ["=="]}
SWAPS = {"+": "-", "-": "+", "*": "/", "/": "*", "%": "*", "&&": "||", "||": "&&", "<<": ">>", ">>": "<<", "&": "|", "|": "&"}
COMPOUND = {"+=": "-=", "-=": "+=", "*=": "/=", "/=": "*=", "|=": "&=", "&=": "|=", "^=": "|=", "<<=": ">>=", ">>=": "<<="}
NUMBERS = {TypeKind.CHAR_U, TypeKind.UCHAR, TypeKind.USHORT, TypeKind.UINT, TypeKind.ULONG, TypeKind.ULONGLONG, TypeKind.CHAR_S,
           TypeKind.SCHAR, TypeKind.SHORT, TypeKind.INT, TypeKind.LONG, TypeKind.LONGLONG, TypeKind.FLOAT, TypeKind.DOUBLE}
FUNCTIONS = {Kind.FUNCTION_DECL, Kind.CXX_METHOD, Kind.CONSTRUCTOR, Kind.DESTRUCTOR, Kind.CONVERSION_FUNCTION, Kind.FUNCTION_TEMPLATE,
             Kind.LAMBDA_EXPR}
STATEMENTS = {Kind.CALL_EXPR, Kind.BINARY_OPERATOR, Kind.COMPOUND_ASSIGNMENT_OPERATOR, Kind.UNARY_OPERATOR, Kind.CXX_THROW_EXPR,
              Kind.CONTINUE_STMT, Kind.BREAK_STMT}
# What stands in these is needed while compiling, or is a declaration that every user of a header would see.
NEVER = {Kind.STATIC_ASSERT, Kind.ENUM_DECL, Kind.PARM_DECL, Kind.FIELD_DECL, Kind.CONCEPT_DECL if hasattr(Kind, "CONCEPT_DECL") else None,
         Kind.TEMPLATE_TYPE_PARAMETER, Kind.TEMPLATE_NON_TYPE_PARAMETER, Kind.TYPEDEF_DECL, Kind.TYPE_ALIAS_DECL,
         Kind.TYPE_ALIAS_TEMPLATE_DECL, Kind.FRIEND_DECL}


@dataclasses.dataclass
class Place:
    """A piece of a file, bytes [start, end), and what can stand there instead."""
    file: str
    start: int
    end: int
    line: int
    kind: str
    original: str
    mutated: str
    schema: str


class Finder:
    def __init__(self, texts):
        self.texts = texts
        self.places = []
        self.macros = []
        self.closed = {}  # per file: ranges of code that is compiled once per target (Highway)

    def text(self, file, start, end):
        return self.texts[file][start:end].decode()

    def span(self, cursor):
        return cursor.extent.start.offset, cursor.extent.end.offset

    def add(self, file, start, end, kind, mutated, schema):
        text = self.texts[file]
        if any(name == file and a < end and start < b for name, a, b in self.macros + self.closed.get(file, [])):
            return
        original = text[start:end].decode()
        if "//" in original or "#" in original or len(original) > 600 or "R\"" in original:
            return
        line = text.count(b"\n", 0, start) + 1
        self.places.append(Place(file, start, end, line, kind, original, mutated, schema))

    def choose(self, cursor, file, kind, mutated):
        """An expression: one or the other."""
        start, end = self.span(cursor)
        mutated = " ".join(mutated.split())
        self.add(file, start, end, kind, mutated, f"(::deform_mutant::on(@) ? ({mutated}) : ({self.text(file, start, end)}))")

    def drop(self, cursor, file):
        start, end = self.span(cursor)
        if re.search(r"(\.|->)(reserve|shrink_to_fit)\(", self.text(file, start, end)):
            return  # only saves time
        tail = re.match(rb"\s*;", self.texts[file][end:])
        if tail:
            end += tail.end()
            original = self.text(file, start, end)
            self.add(file, start, end, "statement dropped", "", "{ if (!::deform_mutant::on(@)) { %s } }" % original)

    def operator(self, cursor, file):
        left, right = list(cursor.get_children())[:2]
        between = self.text(file, left.extent.end.offset, right.extent.start.offset)
        found = re.fullmatch(r"[\s)]*([-+*/%<>=!&|^]+)[\s(]*", between)
        if not found:
            return None
        start, end = self.span(cursor)
        at = left.extent.end.offset + found.start(1)
        return found.group(1), self.text(file, start, at), self.text(file, at + len(found.group(1)), end)

    def is_number(self, cursor):
        return cursor.type.get_canonical().kind in NUMBERS

    def may_compute(self, cursor):
        kind = cursor.type.get_canonical().kind
        return kind in NUMBERS or kind in (TypeKind.BOOL, TypeKind.POINTER, TypeKind.DEPENDENT, TypeKind.UNEXPOSED)

    def expression(self, cursor, file, parent):
        kind = cursor.kind
        start, end = self.span(cursor)
        text = self.text(file, start, end)
        if kind in (Kind.BINARY_OPERATOR, Kind.COMPOUND_ASSIGNMENT_OPERATOR):
            parts = self.operator(cursor, file) if len(list(cursor.get_children())) == 2 and self.may_compute(cursor) else None
            if parts:
                name, left, right = parts
                for other in COMPARISONS.get(name, []):
                    label = "comparison negated" if {name, other} in ({"<", ">="}, {">", "<="}, {"==", "!="}) else "boundary changed"
                    self.choose(cursor, file, label, f"{left}{other}{right}")
                if name in SWAPS:
                    self.choose(cursor, file, "operator exchanged", f"{left}{SWAPS[name]}{right}")
                if name in COMPOUND:
                    self.choose(cursor, file, "operator exchanged", f"{left}{COMPOUND[name]}{right}")
        elif kind == Kind.CALL_EXPR and cursor.spelling in ("operator+", "operator-"):
            type_name = cursor.type.get_canonical().spelling
            if re.match(r"(const )?(deform::|std::array<)", type_name) and len(list(cursor.get_children())) == 3:
                first, _, last = sorted(cursor.get_children(), key=lambda c: c.extent.start.offset)
                between = self.text(file, first.extent.end.offset, last.extent.start.offset)
                found = re.fullmatch(r"[\s)]*([-+])[\s(]*", between)
                if found:
                    at = first.extent.end.offset + found.start(1)
                    self.choose(cursor, file, "operator exchanged",
                                self.text(file, start, at) + SWAPS[found.group(1)] + self.text(file, at + 1, end))
        elif kind == Kind.CALL_EXPR and cursor.spelling in ("min", "max") and text.startswith("std::" + cursor.spelling):
            other = {"min": "max", "max": "min"}[cursor.spelling]
            self.choose(cursor, file, "min and max exchanged", "std::" + other + text[len("std::min"):])
        elif kind in (Kind.INTEGER_LITERAL, Kind.FLOATING_LITERAL, Kind.CXX_BOOL_LITERAL_EXPR):
            whole = self.texts[file]
            before, after = whole[start - 1:start], whole[end:end + 1]
            named = parent.kind in (Kind.DECL_REF_EXPR, Kind.MEMBER_REF_EXPR, Kind.TYPE_REF, Kind.TEMPLATE_REF, Kind.CASE_STMT)
            of_type = parent.kind == Kind.VAR_DECL and (start < parent.location.offset or before == b"[")
            if before in (b"<", b"'") or after in (b">", b"'") or named or of_type:
                return
            if kind == Kind.CXX_BOOL_LITERAL_EXPR:
                self.choose(cursor, file, "constant changed", {"true": "false", "false": "true"}.get(text, text))
            elif kind == Kind.FLOATING_LITERAL:
                zero = re.fullmatch(r"[0.]+", text)
                self.choose(cursor, file, "constant changed", "1.0" if zero else f"{text} * 2")
            elif text == "1":
                self.choose(cursor, file, "constant changed", "0")
                self.choose(cursor, file, "constant changed", "2")
            else:
                self.choose(cursor, file, "constant changed", f"{text} + 1")

    def visit(self, cursor, file, parent, function):
        kind = cursor.kind
        if kind in NEVER:
            return
        start, end = self.span(cursor)
        children = list(cursor.get_children())
        if kind in FUNCTIONS:
            body = next((c for c in reversed(children) if c.kind == Kind.COMPOUND_STMT), None)
            if body is None:
                return
            head = self.text(file, start, body.extent.start.offset)
            if re.search(r"\b(constexpr|consteval)\b|= default", head):
                return
            function = cursor
        if kind == Kind.VAR_DECL:
            if function is None or re.search(r"\b(constexpr|constinit|static)\b", self.text(file, start, max(start, cursor.location.offset))):
                return
        if function is not None:
            self.expression(cursor, file, parent)
            if kind == Kind.IF_STMT:
                head = self.text(file, start, end)
                if re.match(r"if constexpr", head):
                    children = children[1:]
                elif children and re.fullmatch(r"if \(\s*", self.text(file, start, children[0].extent.start.offset)):
                    condition = children[0]
                    if condition.kind not in (Kind.VAR_DECL, Kind.DECL_STMT):
                        self.choose(condition, file, "condition negated", f"!({self.text(file, *self.span(condition))})")
            if kind == Kind.RETURN_STMT and children:
                value = children[0]
                type_kind = value.type.get_canonical().kind
                words = self.text(file, *self.span(value))
                if type_kind == TypeKind.BOOL:
                    self.choose(value, file, "return value changed", f"!({words})")
                elif type_kind in NUMBERS:
                    self.choose(value, file, "return value changed", f"({words}) + 1")
                elif type_kind == TypeKind.RECORD and function.kind != Kind.LAMBDA_EXPR and not re.fullmatch(r"\{\s*\}|std::nullopt", words):
                    tail = re.match(rb"\s*;", self.texts[file][end:])
                    if tail:
                        whole = self.text(file, start, end + tail.end())
                        self.add(file, start, end + tail.end(), "return value changed", "return {};",
                                 "{ if (::deform_mutant::on(@)) { return {}; } %s }" % whole)
        for number, child in enumerate(children):
            where = child.extent.start.file
            if where is None or where.name != file:
                continue
            inner = child
            while inner.kind == Kind.UNEXPOSED_EXPR and len(list(inner.get_children())) == 1:
                below = list(inner.get_children())[0]
                if self.span(below) != self.span(inner):
                    break
                inner = below
            is_body = kind == Kind.COMPOUND_STMT or (kind == Kind.IF_STMT and number > 0) or (
                kind in (Kind.FOR_STMT, Kind.WHILE_STMT, Kind.CXX_FOR_RANGE_STMT) and number == len(children) - 1)
            if function is not None and is_body and inner.kind in STATEMENTS:
                self.drop(inner, file)
            if kind == Kind.CASE_STMT and number == 0:
                continue
            self.visit(child, file, cursor, function)


def find_places(source, files, arguments):
    """All places in `files` (absolute; the source, or headers that it includes)."""
    texts = {name: open(name, "rb").read() for name in files}
    finder = Finder(texts)
    for name, text in texts.items():
        finder.closed[name] = [(name, m.start(), m.end()) for m in
                               re.finditer(rb"HWY_BEFORE_NAMESPACE.*?HWY_AFTER_NAMESPACE", text, re.S)]
    unit = cindex.Index.create().parse(source, args=arguments, options=cindex.TranslationUnit.PARSE_DETAILED_PROCESSING_RECORD)
    for cursor in unit.cursor.get_children():
        if cursor.kind == Kind.MACRO_INSTANTIATION and cursor.extent.start.file and cursor.extent.start.file.name in texts:
            finder.macros.append((cursor.extent.start.file.name, *finder.span(cursor)))
    for cursor in unit.cursor.get_children():
        where = cursor.location.file
        if where is not None and where.name in texts and not cursor.kind.is_preprocessing():
            finder.visit(cursor, where.name, unit.cursor, None)
    unique = {(p.file, p.start, p.end, p.mutated, p.kind): p for p in finder.places if p.original != p.mutated}
    return list(unique.values())
