"""Numbers on the command line: callbacks that read an option's text."""

from __future__ import annotations

from collections.abc import Callable

import click

from ribbon_cli.expression import ExpressionError, evaluate


def whole(low: int) -> Callable[[click.Context, click.Parameter, str | None], int | None]:
    """A callback that reads an option's value as a whole number, `low` or more."""

    def read(ctx: click.Context, parameter: click.Parameter, text: str | None) -> int | None:
        if text is None:
            return None
        if not (text.isascii() and text.isdigit() and len(text) < 10 and int(text) >= low):
            raise click.BadParameter(f"must be a whole number, {low} or more, got {text!r}", ctx, parameter)
        return int(text)

    return read


def finite(ctx: click.Context, parameter: click.Parameter, text: str | None) -> float | None:
    """Read a number as configs spell it: 0.5, 1e-3, -pi/30."""
    if text is None:
        return None

    try:
        value = evaluate(text)
    except ExpressionError as error:
        message = f"must be a number such as 0.5 or pi/30, got {text!r} ({error})"
        raise click.BadParameter(message, ctx, parameter) from error
    return value


def positive(ctx: click.Context, parameter: click.Parameter, text: str | None) -> float | None:
    """Read a positive number as configs spell it."""
    value = finite(ctx, parameter, text)
    if value is not None and not value > 0.0:
        raise click.BadParameter(f"must be > 0 and finite, got {text!r}", ctx, parameter)
    return value


def several(ctx: click.Context, parameter: click.Parameter, texts: tuple[str, ...]) -> tuple[float, ...]:
    """Read numbers of an option that may be given several times; each value once, ascending."""
    return tuple(sorted({finite(ctx, parameter, text) or 0.0 for text in texts}))
