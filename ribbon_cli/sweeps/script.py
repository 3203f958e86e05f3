"""Scripts that run a sweep as a job array: submitting one again is the retry."""

from __future__ import annotations

import math
import os
import shlex
import sys
from pathlib import Path

from .. import config as configs
from ..errors import UsageError
from .resources import memory_of
from .run import cost_of

SCRIPTS = ("slurm",)
MOST_ELEMENTS = 1000
"""Slurm's usual limit of a job array."""
_MARGIN, _LEAST = 10.0, 10
"""How many times the estimated seconds a job gets, and minutes at least."""

_SLURM = """\
#!/bin/sh
#SBATCH --job-name={name}
#SBATCH --array=0-{last}
#SBATCH --ntasks=1
#SBATCH --cpus-per-task=1
#SBATCH --mem={memory}M
#SBATCH --time={minutes}
#SBATCH --output={name}-%A_%a.log
#SBATCH --open-mode=append
#SBATCH --signal=B:TERM@60
# {points} points{shares}. Submit this again to go on with runs that the time limit ended, and to
# try those again that failed; the others are passed over.
cd {folder} || exit 2
exec {command}
"""
"""`exec` keeps the exit code, and brings the signal before the time limit to ribbon itself. What a job has
written before it is requeued stays."""


def script_of(kind: str, sweep: configs.Sweep, root: Path) -> str:
    """The text of a script. Raises UsageError for a kind that there is not."""
    if kind not in SCRIPTS:
        raise UsageError(f"no script {kind!r}: there is {', '.join(SCRIPTS)}")
    count = len(sweep.points)
    elements = min(count, MOST_ELEMENTS)
    each = math.ceil(count / elements)
    index = "$SLURM_ARRAY_TASK_ID" if each == 1 else f"$SLURM_ARRAY_TASK_ID:{count}:{elements}"
    dearest = max(cost_of(point, root) for point in sweep.points)
    words = [sys.executable, "-m", "ribbon_cli", "sweep", os.path.abspath(sweep.path)]
    words += ["--runs", os.path.abspath(root), "--retry", "--array-index"]
    return _SLURM.format(
        name=sweep.name,
        last=elements - 1,
        memory=memory_of(point.config for point in sweep.points) >> 20,
        minutes=max(_LEAST, math.ceil(_MARGIN * each * dearest / 60.0)),
        points=count,
        shares="" if each == 1 else f", up to {each} an element",
        folder=shlex.quote(os.getcwd()),
        command=f'{shlex.join(words)} "{index}"',
    )
