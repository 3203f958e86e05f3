"""From text to a tree of nodes that know their line and column: YAML without its dangerous parts.

The parser's events are read one by one, so that reading stops at the first sign of a document made to
exhaust memory or stack. Anchors, aliases, tags, directives and further documents are refused; scalars
stay text, because YAML 1.1 reads them as users do not expect (`1e-3` a string, `010` eight, `no` false).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Literal

import yaml

from ribbon_cli.config.mistakes import Mistakes, shown
from ribbon_cli.config.syntax import explain

MAX_BYTES = 1 << 20
_MAX_DEPTH = 12
_MAX_NODES = 25_000  # 10 000 widths, as many again in `at`, and the rest
_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

_LINE_BREAK = re.compile(r"\r\n|\r|\n")
_REFUSED = (
    # What YAML does not allow, and the line breaks that only YAML counts as such (NEL, LS, PS).
    (
        re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff\ufeff\ufffe\uffff]"),
        "control character U+{:04X}: remove it",
    ),
    (
        re.compile(r"^[^#\t\r\n]*(\t)", re.MULTILINE),
        "tab character: indent and separate with spaces alone",
    ),
    (re.compile("^%", re.MULTILINE), "YAML directives (%) are not accepted: remove the line"),
)
"""Characters that are refused, in the last group or the whole of a match, and the message about them."""


@dataclass(slots=True)
class Node:
    """One value of the document; `line` and `column` count from 1.

    A scalar has its `text` and whether it was `quoted` (a block scalar counts as such); a list its `items`; a
    mapping its keys and values, alternating, in `items`. An "invalid" node stands for one whose mistake is
    already recorded: readers skip it silently. `file` is where it stands, where that is another file than the
    one that is read.
    """

    line: int
    column: int
    kind: Literal["scalar", "list", "mapping", "invalid"]
    text: str = ""
    quoted: bool = False
    items: list[Node] = field(default_factory=list)
    file: str = ""


class _StopReading(Exception):  # noqa: N818  (not an error: the mistake is on record)
    """The rest of the document is not worth reading."""


def position(text: str, index: int) -> tuple[int, int]:
    """Line and column, from 1, of the character `text[index]`."""
    line, start = 1, 0
    for match in _LINE_BREAK.finditer(text, 0, index):
        line, start = line + 1, match.end()
    return line, index - start + 1


def read_document(text: str, mistakes: Mistakes, loader: Any = _LOADER) -> Node | None:
    """The document's root, a mapping; None (with the mistake recorded) where there is none."""
    text = text.removeprefix("\ufeff")
    if not _fit_for_yaml(text, mistakes):
        return None
    builder = _Builder(mistakes)
    try:
        for event in yaml.parse(text, Loader=loader):
            builder.add(event)
    except _StopReading:
        return None
    except yaml.MarkedYAMLError as error:
        line, column, message = explain(error)
        # Report what is missing at the end after the last character, not on a line below it.
        end = position(text, len(text.rstrip(" \r\n")))
        mistakes.add(*min((line, column), end), "", message)
        return None
    except (yaml.YAMLError, ValueError, OverflowError):  # the last two: an escape beyond Unicode
        mistakes.add(*builder.last, "", "not valid YAML: the text after this point cannot be read")
        return None
    return _mapping(builder.root, mistakes)


def _fit_for_yaml(text: str, mistakes: Mistakes) -> bool:
    """Whether YAML, editors and readers agree about all characters."""
    if len(text) > MAX_BYTES:
        mistakes.add(0, 0, "", "larger than 1 MiB, which no config needs")
        return False
    before = len(mistakes.found)
    for pattern, message in _REFUSED:
        for match in pattern.finditer(text):
            at = match.start(match.lastindex or 0)
            mistakes.add(*position(text, at), "", message.format(ord(text[at])))
    return len(mistakes.found) == before


def _mapping(root: Node | None, mistakes: Mistakes) -> Node | None:
    empty = root is None or (root.kind == "scalar" and not root.text and not root.quoted)
    if empty:
        mistakes.add(1, 1, "", "the file holds no settings; `ribbon init` writes a config to start from")
        return None
    if root is None or root.kind == "invalid":
        return None
    if root.kind != "mapping":
        found = "a list" if root.kind == "list" else shown(root.text)
        expected = "must be settings such as 'length: 2*pi', each on its line"
        mistakes.add(root.line, root.column, "", f"{expected}, got {found}")
        return None
    return root


class _Builder:
    """Builds a tree from the parser's events, without recursion."""

    def __init__(self, mistakes: Mistakes) -> None:
        self.root: Node | None = None
        self.last = (1, 1)
        self._mistakes = mistakes
        self._open: list[Node] = []
        self._count = 0
        self._documents = 0

    def add(self, event: yaml.Event) -> None:
        """Take in the next event; raises _StopReading where the rest must not be read."""
        if event.start_mark is not None:
            self.last = (event.start_mark.line + 1, event.start_mark.column + 1)
        if isinstance(event, yaml.DocumentStartEvent):
            self._documents += 1
            if self._documents > 1:
                self._stop("a second document: a config is one document, without a further '---'")
        elif isinstance(event, yaml.CollectionEndEvent):
            self._open.pop()
        elif isinstance(event, yaml.NodeEvent):
            self._place(event)

    def _place(self, event: yaml.NodeEvent) -> None:
        self._count += 1
        if self._count > _MAX_NODES:
            self._stop(f"more than {_MAX_NODES} values, which no config needs")
        node = self._node(event)
        if self._open:
            self._open[-1].items.append(node)
        else:
            self.root = node
        if isinstance(event, yaml.CollectionStartEvent):
            if len(self._open) == _MAX_DEPTH:
                self._stop(f"more than {_MAX_DEPTH} levels of nesting, which no config needs")
            # The contents of a refused collection are still read, below its invalid node.
            self._open.append(node)

    def _node(self, event: yaml.NodeEvent) -> Node:
        line, column = self.last
        refused = self._refused(event)
        if refused:
            self._mistakes.add(line, column, "", refused)
            return Node(line, column, "invalid")
        if isinstance(event, yaml.ScalarEvent):
            return Node(line, column, "scalar", event.value, quoted=event.style in ("'", '"', "|", ">"))
        return Node(line, column, "list" if isinstance(event, yaml.SequenceStartEvent) else "mapping")

    @staticmethod
    def _refused(event: Any) -> str:
        if isinstance(event, yaml.AliasEvent):
            return f"aliases (*{shown(event.anchor or '')}) are not accepted: write the value"
        if event.anchor is not None:
            return f"anchors (&{shown(event.anchor)}) are not accepted: remove it"
        if event.tag is not None:
            tag = event.tag.replace("tag:yaml.org,2002:", "!!")
            return f"tags ({shown(tag)}) are not accepted: remove it"
        return ""

    def _stop(self, message: str) -> None:
        self._mistakes.add(*self.last, "", message)
        raise _StopReading
