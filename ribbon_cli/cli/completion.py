"""Shell completion: what Tab offers, and the scripts that ask for it.

The callbacks run whenever Tab is pressed, whatever is in the folder: they never raise and never print.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import click
from click.shell_completion import (
    BashComplete,
    CompletionItem,
    add_completion_class,
    get_completion_class,
    split_arg_string,
)

from ribbon_cli import config, store, study
from ribbon_cli.parts import HALF_WIDTH, PARAMETERS

SHELLS = ("bash", "zsh", "fish")
_MOST = 500
"""Most candidates that are worth showing."""
_PLAIN = r"[\w.@:=,+-]*"
"""Characters that every shell takes as plain text; folders with other names are not offered."""

_BASH = """\
%(complete_func)s() {
    local IFS=$'\\n'
    local kind value
    COMPREPLY=()
    while IFS=',' read -r kind value; do
        case $kind in
            dir) compopt -o dirnames ;;
            file) compopt -o default ;;
            open) compopt -o nospace; COMPREPLY+=("$value") ;;
            plain) COMPREPLY+=("$value") ;;
        esac
    done < <(env COMP_LINE="$COMP_LINE" COMP_POINT="$COMP_POINT" COMP_WORDBREAKS="$COMP_WORDBREAKS" \\
        %(complete_var)s=bash_complete "$1" 2>/dev/null)
    return 0
}

complete -o nosort -F %(complete_func)s %(prog_name)s
"""


def register_bash() -> None:
    """Replace click's completion for bash by one that knows references.

    Bash breaks words at ':', '=' and '@', so that click sees RUN:12 as three of them. Ours reads the line
    itself, and leaves out of each candidate what bash takes for earlier words.
    """

    class Bash(BashComplete):
        source_template = _BASH

        def get_completion_args(self) -> tuple[list[str], str]:
            # COMP_POINT counts bytes.
            line = os.fsencode(os.environ.get("COMP_LINE", ""))
            line = line[: int(os.environ.get("COMP_POINT", len(line)))]
            words = split_arg_string(os.fsdecode(line))
            open_word = bool(line) and not line[-1:].isspace()
            incomplete = words.pop() if open_word and len(words) > 1 else ""
            # Of --option=VALUE, candidates are values alone, and bash has broken the word there anyhow.
            value = incomplete.partition("=")[2] if incomplete.startswith("-") else incomplete
            breaks = set(os.environ.get("COMP_WORDBREAKS", "")) - set(" \t\n")
            # The word that bash replaces begins behind the last break, but with an '@'.
            self._hidden = max([0, *(value.rfind(mark) + (mark != "@") for mark in breaks)])
            return words[1:], incomplete

        def format_completion(self, item: CompletionItem) -> str:
            value = str(item.value)
            kind = "open" if item.type == "plain" and value.endswith((":", "@", ",")) else item.type
            return f"{kind},{value[self._hidden :]}"

    add_completion_class(Bash)


def script(cli: click.Command, shell: str, program: str) -> str:
    """The text that makes a shell complete `program`'s command lines. Raises ValueError for other shells."""
    register_bash()
    found = get_completion_class(shell)
    if found is None:
        raise ValueError(f"no completion for {shell}")
    completion = found(cli, {}, program, f"_{program.upper()}_COMPLETE")
    # Bash's own `source` starts a bash to ask for its version first.
    if isinstance(completion, BashComplete):
        return completion.source_template % completion.source_vars()
    return completion.source()


_Callback = Callable[["click.Context", "click.Parameter", str], list["CompletionItem"]]


def _candidates(find: Callable[[click.Context, str], Iterable[str]], kind: str = "") -> _Callback:
    """A callback that offers what `find` gives, and files as well (`kind` "file") when that is nothing."""

    def complete(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
        found: list[str] = []
        try:
            for value in dict.fromkeys(find(ctx, incomplete)):
                if value.startswith(incomplete) and re.fullmatch(_PLAIN, value) and len(found) < _MOST:
                    found.append(value)
        except Exception:  # noqa: BLE001  (a damaged run must not put a traceback into the user's line)
            found = []
        items = [CompletionItem(value) for value in found]
        return items or ([CompletionItem(incomplete, type=kind)] if kind else [])

    return complete


def _root(ctx: click.Context) -> Path:
    """Folder of the runs, by the options typed so far: those that `settings` keeps, which imports this."""
    return store.runs_root(getattr(ctx.obj, "runs", None))


def _runs(ctx: click.Context) -> list[tuple[str, store.Run]]:
    """The runs, each under its short name where that names no other run."""
    runs = store.list_runs(_root(ctx))
    names = [run.short_name for run in runs]
    return [(run.short_name if names.count(run.short_name) == 1 else run.name, run) for run in runs]


def _run_names(ctx: click.Context, incomplete: str) -> Iterator[str]:
    return (name for name, _ in _runs(ctx))


def _listed(ctx: click.Context, incomplete: str) -> Iterator[str]:
    yield from store.list_sweeps(_root(ctx))
    yield from _run_names(ctx, incomplete)


def _references(ctx: click.Context, incomplete: str) -> Iterator[str]:
    """Runs with a colon, or the states of one when there is only one: by label, or by place after an @."""
    fitting = [(name, run) for name, run in _runs(ctx) if name.startswith(incomplete)]
    if len(fitting) > 1:
        yield from (f"{name}:" for name, _ in fitting)
        return
    mark = "@" if "@" in incomplete else ":"
    typed = incomplete.partition(mark)[0]
    # A complete name may be typed in any accepted form.
    name, run = fitting[0] if fitting else (typed, store.find_run(_root(ctx), typed))
    if mark == ":":
        yield from (f"{name}:{label}" for label in run.entries())
        return
    states = run.states()
    shown = (HALF_WIDTH, *store.varying(states))
    for state in states:
        said = (f"{PARAMETERS[p].symbol}={state.parameters[p]:.10g}," for p in shown)
        yield f"{name}@{''.join(said)}N={state.segments}"


def _states_or_runs(ctx: click.Context, incomplete: str) -> Iterator[str]:
    if not {":", "@"} & set(incomplete):
        yield from _run_names(ctx, incomplete)
    yield from _references(ctx, incomplete)


def _all_or_one(ctx: click.Context, incomplete: str) -> Iterator[str]:
    yield "all"
    yield from _states_or_runs(ctx, incomplete)


def complete_words(words: tuple[str, ...]) -> _Callback:
    """A callback that offers fixed words."""
    return _candidates(lambda ctx, _: words)


class Word(click.ParamType):  # type: ignore[type-arg]  # generic in new versions of click alone
    """One of a few words, offered by Tab, and listed where it is missing; the command itself judges it."""

    name = "word"

    def __init__(self, words: tuple[str, ...]) -> None:
        self._words = words

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Offer the words."""
        return complete_words(self._words)(ctx, param, incomplete)

    def get_missing_message(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """List the words; click before 8.2 gives no context."""
        return f"Choose one of {', '.join(self._words)}"


complete_run = _candidates(_run_names)
complete_listed = _candidates(_listed)
complete_state = _candidates(_references, "file")
complete_any = _candidates(_states_or_runs, "file")
complete_checkable = _candidates(_all_or_one, "file")
# Statuses of runs or, where the line names one, of states.
complete_status = _candidates(
    lambda ctx, _: study.STATE_STATUSES if ctx.params.get("run") else study.RUN_STATUSES
)
complete_kind = _candidates(lambda ctx, _: store.KINDS)
complete_parameter = _candidates(lambda ctx, _: PARAMETERS)
complete_contact = _candidates(lambda ctx, _: ("forces", "record"))
complete_template = _candidates(lambda ctx, _: config.templates())
complete_file = _candidates(lambda ctx, _: (), "file")
complete_folder = _candidates(lambda ctx, _: (), "dir")


def complete_source(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Offer runs, and config files beside them."""
    return [*complete_run(ctx, parameter, incomplete), *complete_file(ctx, parameter, incomplete)]
