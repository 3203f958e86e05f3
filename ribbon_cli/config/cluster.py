"""A settings file of a cluster of Slurm's jobs, on which Dask runs a sweep."""

from __future__ import annotations

import os
from dataclasses import dataclass

from ribbon_cli.config.document import read_document
from ribbon_cli.config.mistakes import Mistakes
from ribbon_cli.config.parse import read_text
from ribbon_cli.config.reader import Reader
from ribbon_cli.keys import Integer, Items, Key, Section, Text


@dataclass(frozen=True)
class Cluster:
    """So many jobs with one worker each; what is None is left to Slurm, and the memory to the runs."""

    jobs: int
    walltime: str
    memory: int | None = None
    partition: str | None = None
    account: str | None = None
    directives: tuple[str, ...] = ()
    logs: str | None = None


_WORD = r"[^\x00-\x20]+"
CLUSTER = Section(
    (
        Key("jobs", Integer(1, 10_000), "number of jobs, each with one worker", required="how many jobs"),
        Key(
            "walltime",
            Text("a time as Slurm reads it, 01:00:00", r"[0-9:-]+", 40),
            "time limit of a job",
            required="a time as Slurm reads it, 01:00:00",
        ),
        Key("memory", Integer(1, 10**7), "memory of a job in MiB", otherwise="as the runs need"),
        Key("partition", Text("a partition's name", _WORD, 200), "partition", otherwise="Slurm's"),
        Key("account", Text("an account's name", _WORD, 200), "account", otherwise="Slurm's"),
        Key(
            "directives",
            Items(Text("an option of sbatch, --qos=long", r"-[^\x00-\x1f]+", 1024), 50),
            "further options of sbatch",
        ),
        Key("logs", Text("a folder", r"[^\x00-\x1f]+", 1024), "folder of the jobs' output", otherwise="here"),
    ),
    "a cluster",
)


def load_cluster(path: str | os.PathLike[str]) -> Cluster:
    """Read and check a settings file. Raises ConfigError with everything that is wrong."""
    file = os.fsdecode(path)
    mistakes = Mistakes(file)
    root = read_document(read_text(file, mistakes), mistakes)
    if root is None:
        raise mistakes.error()
    reader = Reader(mistakes)
    found = reader.section(root, "", CLUSTER)
    values = {name: found.read(name) for name in found.nodes if name != "directives"}
    directives = tuple(value for _, _, value in found.items("directives"))
    if mistakes.found:
        raise mistakes.error()
    return Cluster(**values, directives=directives)
