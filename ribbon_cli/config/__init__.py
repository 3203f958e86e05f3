"""Configs: YAML with positions in, checked and resolved records out."""

from ribbon_cli.config.mistakes import ConfigError, Mistake
from ribbon_cli.config.parse import load_config, parse_config
from ribbon_cli.config.recipes import RECIPES
from ribbon_cli.config.schema import SCHEMA_FILE, schema
from ribbon_cli.config.templates import templates
from ribbon_cli.config.types import (
    STOPS,
    Arclength,
    Config,
    Guess,
    Refinement,
    SpectrumRequest,
    dump_resolved,
)

__all__ = [
    "RECIPES",
    "SCHEMA_FILE",
    "STOPS",
    "Arclength",
    "Config",
    "ConfigError",
    "Guess",
    "Mistake",
    "Refinement",
    "SpectrumRequest",
    "dump_resolved",
    "load_config",
    "parse_config",
    "schema",
    "templates",
]
