"""`python -m bench.store`: a run of 5000 states listed, looked up, resumed and indexed."""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from ribbon_cli.config import dump_resolved, load_config
from ribbon_cli.store import Run, StateRecord, encode, log
from ribbon_cli.store.folder import state_entry, state_name
from ribbon_cli.store.preamble import block_size, check_seal, seal
from ribbon_cli.store.summaries import Summary
from ribbon_cli.study import plan_of, solve_config

DOCUMENT = Path(__file__).parents[1] / "docs" / "benchmarks-store.md"
STATES = 5000
REPEATS = 5
CONFIG = """\
name: big
topology: {{half_twists: 0}}
initial_guess: {{recipe: cylinder, segments: 8, half_width: {half_width!r}}}
widths: {widths}
spectrum: {{modes: 0, full_up_to: 0}}
"""


def make_run(folder: Path, states: int = STATES) -> Run:
    """A finished run of so many widths.

    The last state but one is what it says; each other file is the first one's with the head of its own state.
    """
    first = folder / "first.yaml"
    first.write_text(CONFIG.format(half_width=0.1, widths="[0.1]"), encoding="utf-8")
    done = solve_config(load_config(first), folder / "first")
    data = done.run.state_path(1).read_bytes()
    summary = check_seal(data) or {}
    size = block_size(summary)
    image = bytes(size) + data[size:]
    path = folder / "big.yaml"
    widths = f"{{from: 0.1, to: 0.5, steps: {states - 1}}}"
    path.write_text(CONFIG.format(half_width=0.1, widths=widths), encoding="utf-8")
    config = load_config(path)
    run = Run.create_or_open(folder / "runs", config.name, config.hash8(), config.text, dump_resolved(config))
    lines = []
    for label, stage in enumerate(plan_of(config).stages, start=1):
        state = summary | {"label": label, "half_width": stage.half_width, "stage": stage.name}
        if label == states - 1:
            record = _solved(folder, stage.half_width or 0.0)
            state = Summary.of(replace(record, label=label, stage=stage.name)).to_dict()
            file = encode(replace(record, label=label, stage=stage.name))
        else:
            file = seal(image, state)
        (run.path / state_name(label)).write_bytes(file)
        lines.append(log.format_line(state_entry(state, file)))
    with open(run.log_path, "ab") as stream:
        stream.write(b"".join(lines))
    return run


def _solved(folder: Path, half_width: float) -> StateRecord:
    """A state of that width."""
    path = folder / "one.yaml"
    path.write_text(CONFIG.format(half_width=half_width, widths=f"[{half_width!r}]"), encoding="utf-8")
    return solve_config(load_config(path), folder / "one").run.load(1)


def forget_last(run: Run, label: int) -> None:
    """Take a run back to where its last state was not committed yet."""
    lines = run.log_path.read_bytes().splitlines(keepends=True)
    while run.state_path(label).exists():
        if lines.pop().startswith(b'{"event":"state"'):
            run.state_path(label).unlink()
    run.log_path.write_bytes(b"".join(lines))


def processor() -> float:
    """Seconds of processor that children took so far."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def seconds(
    folder: Path, *words: str, repeats: int = REPEATS, prepare: Callable[[], None] = lambda: None
) -> tuple[float, float]:
    """Median time of a command line from the start of Python to its end, and of processor in it."""
    times, busy = [], []
    for _ in range(repeats):
        prepare()
        started, before = time.perf_counter(), processor()
        done = subprocess.run(
            [sys.executable, "-m", "ribbon_cli", *words], cwd=folder, capture_output=True, check=False
        )
        times.append(time.perf_counter() - started)
        busy.append(processor() - before)
        if done.returncode:
            raise RuntimeError(f"{words}: exit code {done.returncode}: {done.stderr.decode()[-300:]}")
    return statistics.median(times), statistics.median(busy)


def measure(folder: Path, states: int = STATES) -> list[tuple[str, tuple[float, float], float | None]]:
    """Rows of (what, (seconds, seconds of processor), limit)."""
    run = make_run(folder, states)
    os.sync()  # what is still being written to the disk is not to be measured
    last = f"big:{states}"
    rows: list[tuple[str, tuple[float, float], float | None]] = [
        ("start of Python and nothing else (`ribbon --version`)", seconds(folder, "--version"), None),
        ("`ribbon ls`", seconds(folder, "ls"), 1.0),
        ("`ribbon ls RUN`, every file's hash compared", seconds(folder, "ls", "big"), 1.0),
        ("`ribbon path RUN:LABEL`", seconds(folder, "path", last), 1.0),
        ("`ribbon path RUN@b=...`", seconds(folder, "path", "big@b=0.5"), 1.0),
        ("`ribbon solve` of the finished run", seconds(folder, "solve", "big.yaml", "-q"), 1.0),
        (
            "`ribbon solve` with the last state to compute and commit",
            seconds(folder, "solve", "big.yaml", "-q", prepare=lambda: forget_last(run, states)),
            None,
        ),
    ]
    run.log_path.unlink()
    rows.append(("`ribbon repair` without a log", seconds(folder, "repair", "big", repeats=1), 20.0))
    return rows


def main() -> int:
    """Measure, and write the page; 1 where a limit is not kept."""
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        rows = measure(Path(name))
    lines = [
        "# Benchmarks of the store",
        "",
        f"A finished run of {STATES} states of some 40 kB each, in the file system's cache. Median seconds",
        f"of whole processes, by `make bench` at a load of {load:.1f} on {os.cpu_count()} processors;",
        "where the load is above their number, the seconds of processor tell more.",
        "",
        "| command | seconds | of processor | limit |",
        "|---|---|---|---|",
    ]
    for what, (took, busy), most in rows:
        lines.append(f"| {what} | {took:.2f} | {busy:.2f} | {'' if most is None else f'{most:g}'} |")
    DOCUMENT.write_text("\n".join(lines) + "\n", encoding="utf-8")
    sys.stdout.write("\n".join(lines) + "\n")
    return int(any(most is not None and took > most for _, (took, _), most in rows))


if __name__ == "__main__":
    sys.exit(main())
