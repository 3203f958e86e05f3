"""Damaged and hostile files: every flipped byte and every truncation is seen; no file brings the process
down.
"""

from __future__ import annotations

import contextlib
import random
import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from cli_support import ribbon
from fault_support import Ended, limited
from store_support import reseal

from ribbon_cli.cli.main import cli
from ribbon_cli.errors import StoreError
from ribbon_cli.report.comparison import compare_states
from ribbon_cli.store import Run, decode, encode
from ribbon_cli.store.content import values_sha256
from ribbon_cli.store.hdf5 import _read_values, decode_bytes

FREE = {f"/origin/{name}" for name in ("label", "stage", "method", "newton_steps", "events")}
FREE |= {"/origin/parent", "/origin/parent_ref", "/certificate/message"}
"""What no shape determines, so that only a hash that was not forged protects it."""
ROUNDING = 1e-11
FROZEN = Path(__file__).parent / "data" / "format-1.0"


@pytest.fixture(scope="module")
def state() -> bytes:
    """A small solved state, in today's format.

    It is verified here, so that children, which are forked, find everything imported.
    """
    (path,) = FROZEN.glob("*/states/0006.h5")
    assert ribbon("verify", path, "-q").exit_code == 0
    return encode(decode(path))


def refused(data: bytes) -> bool:
    try:
        decode_bytes(data, "x.h5")
    except StoreError as error:
        return "\n" not in str(error)
    return False


def flips(data: bytes, positions: range, seed: int) -> None:
    chance = random.Random(seed)
    for position in positions:
        bad = bytearray(data)
        bad[position] ^= 1 << chance.randrange(8)
        assert refused(bytes(bad)), position


def test_flipped_bytes_are_seen(state):
    flips(state, range(0, 120), seed=1)
    flips(state, range(120, len(state), 131), seed=2)


@pytest.mark.faults
def test_every_flipped_byte_is_seen(state):
    flips(state, range(len(state)), seed=3)


def test_every_truncation_is_seen(state):
    for size in range(0, len(state), 64):
        assert refused(state[:size])
    assert refused(state + b"\0")


def test_verify_reports_every_flip_in_a_run_of_either_format(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(FROZEN, tmp_path / "runs")
    (folder,) = (tmp_path / "runs").iterdir()
    path = Run.open(folder).state_path(6)
    good = path.read_bytes()
    for position in range(0, len(good), len(good) // 20):
        bad = bytearray(good)
        bad[position] ^= 1
        path.write_bytes(bad)
        assert ribbon("verify", "frozen:6", "-q").exit_code == 4
        path.write_bytes(good[:position])
        assert ribbon("verify", "frozen:6", "-q").exit_code == 4
    path.write_bytes(good)
    assert ribbon("verify", "frozen:6", "-q").exit_code == 0


# --- mutated files, each read in a child ---


def rehash(path: Path) -> None:
    """Make every hash in a file that of what it holds now, as far as it can be read."""
    with contextlib.suppress(Exception), h5py.File(path, "r+") as file:
        content = values_sha256(_read_values(file))
        file.attrs["content_sha256"] = np.bytes_(content)
        file.flush()
        reseal_with = content
    with contextlib.suppress(Exception):
        reseal(path, content_sha256=reseal_with)
    with contextlib.suppress(Exception):
        reseal(path)


def _datasets(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visititems(lambda name, node: names.append(name) if isinstance(node, h5py.Dataset) else None)
    return names


def _replace(chance: random.Random, file: h5py.File, name: str) -> None:
    """Another value, type or shape for a dataset."""
    old = file[name][()]
    del file[name]
    shape = chance.choice([(), (0,), (3,), (12,), (12, 3), (3, 12), (2, 12, 7), (1, 1, 1, 1), (2**20,)])
    dtype = chance.choice(["f8", "i8", "?", "S3", "f4", ">f8", "u1", "c16", "O", "i1"])
    if chance.random() < 0.3:
        file[name] = np.asarray(old) * 2 if np.asarray(old).dtype.kind == "f" else old
    elif dtype == "O":
        file[name] = "of variable length"
    else:
        file[name] = np.zeros(shape, dtype=dtype)


def _link(chance: random.Random, file: h5py.File, name: str) -> None:
    """A link in place of a dataset, out of the file, to nowhere or in a circle."""
    del file[name]
    parent = name.rpartition("/")[0]
    match chance.randrange(4):
        case 0:
            file[name] = h5py.ExternalLink("/etc/hostname", "/")
        case 1:
            file[name] = h5py.SoftLink("/" + chance.choice([name, "state/u", "nowhere"]))
        case 2:
            file[name] = file[parent]
        case _:
            file[name] = file["/"]


def _storage(chance: random.Random, file: h5py.File, name: str) -> None:
    """Giant shapes, other filters, storage elsewhere."""
    del file[name]
    match chance.randrange(6):
        case 0:
            file.create_dataset(name, (2**40,), "f8", chunks=(1024,), compression="gzip")
        case 1:
            file.create_dataset(name, (2**15, 2**14), "f8", chunks=(64, 64), fillvalue=1.0)
        case 2:
            file.create_dataset(name, data=np.zeros(100), chunks=(100,), scaleoffset=3)
        case 3:
            file.create_dataset(name, data=np.zeros(100), compression="lzf")
        case 4:
            file.create_dataset(name, (100,), "f8", external=[("/etc/hostname", 0, 800)])
        case _:
            layout = h5py.VirtualLayout((10,), "f8")
            layout[:] = h5py.VirtualSource("/etc/hostname", "x", (10,))
            file.create_virtual_dataset(name, layout)


def _value(chance: random.Random, file: h5py.File, name: str) -> None:
    """One number of an array changed."""
    data = np.asarray(file[name][()])
    if data.dtype.kind == "f" and data.size:
        flat = data.reshape(-1)
        place = chance.randrange(flat.size)
        flat[place] = chance.choice([np.nan, np.inf, -1e308, 1e308, flat[place] + 1.0, -flat[place] - 1e-3])
        file[name][...] = flat.reshape(data.shape)
    elif data.dtype.kind == "i" and data.size:
        file[name][...] = data + chance.choice([1, -1, 2**40, -(2**62)])
    else:
        file[name].attrs["units"] = "m"


def structural(chance: random.Random, path: Path) -> None:
    """Change what a file holds through HDF5, then make its hashes right again."""
    with h5py.File(path, "r+") as file:
        for _ in range(chance.choice((1, 1, 2))):
            name = chance.choice(_datasets(file))
            match chance.randrange(7):
                case 0:
                    del file[name]
                case 1:
                    _replace(chance, file, name)
                case 2:
                    _link(chance, file, name)
                case 3:
                    _storage(chance, file, name)
                case 4:
                    _value(chance, file, name)
                case 5:
                    file.create_group(f"{name.rpartition('/')[0]}/{chance.randrange(10**6)}")
                case _:
                    attribute = chance.choice(["format", "format_version", "content_sha256"])
                    file.attrs[attribute] = chance.choice(
                        [b"", b"9" * 300, np.arange(4), 1.5, b"ribbon-state"]
                    )
    rehash(path)


def damaged(chance: random.Random, path: Path, sealed: bool) -> None:
    """Change bytes; `sealed` makes the head's hash right again, so that HDF5 gets to see the damage."""
    data = bytearray(path.read_bytes())
    start = 2048 if sealed else 0
    match chance.randrange(4):
        case 0:
            for _ in range(chance.randint(1, 20)):
                data[chance.randrange(start, len(data))] = chance.randrange(256)
        case 1:
            del data[chance.randrange(start + 1, len(data)) :]
        case 2:
            a, b = sorted(chance.randrange(start, len(data)) for _ in range(2))
            data[a:b] = (
                bytes(b - a) if chance.random() < 0.5 else data[b : 2 * b - a].ljust(b - a, b"\xff")[: b - a]
            )
        case _:
            at = chance.randrange(start, len(data))
            data[at:at] = chance.randbytes(chance.randint(1, 64))
    path.write_bytes(bytes(data))
    if sealed:
        reseal(path)


def read_it(path: Path, state: bytes) -> Callable[[], int]:
    """Verify a file as a user would; 90 where it is accepted though something else than `FREE` is said
    differently.
    """

    def action() -> int:
        try:
            cli.main(["verify", str(path), "-q"])
        except SystemExit as left:
            code = int(left.code or 0)
        if code == 0 and changed(path, state) - FREE:
            print(sorted(changed(path, state)))
            return 90
        return code

    return action


def changed(path: Path, state: bytes) -> set[str]:
    """What a file says differently, provenance left out, and residuals that differ by rounding alone."""
    pairs = compare_states(decode_bytes(state, "as it was"), decode(path))
    return {
        pair.path
        for pair in pairs
        if not pair.equal
        and not pair.path.startswith("/provenance/")
        and not ("residual" in pair.path and pair.difference is not None and pair.difference < ROUNDING)
    }


def mutated(folder: Path, state: bytes, count: int, seed: int) -> dict[int, int]:
    """Mutate and read so many files; how often each exit code came out."""
    chance = random.Random(seed)
    path = folder / "state.h5"
    path.write_bytes(state)
    codes: dict[int, int] = {}
    for k in range(count):
        path.unlink()
        path.write_bytes(state)
        try:
            [structural, lambda c, p: damaged(c, p, True), lambda c, p: damaged(c, p, False)][k % 3](
                chance, path
            )
        except (OSError, RuntimeError, KeyError, ValueError, TypeError):
            path.write_bytes(state[: chance.randrange(len(state))])
        ended = limited(read_it(path, state), folder)
        where = f"mutation {k} of seed {seed}: {ended}"
        assert harmless(ended), where
        assert ended.code in (0, 4), where
        if k % 3 == 2 and path.read_bytes() != state:
            assert ended.code == 4, where
        codes[ended.code] = codes.get(ended.code, 0) + 1
    return codes


def harmless(ended: Ended) -> bool:
    """No traceback, one line, and within 2 s and 1 GiB."""
    return "Traceback" not in ended.output and ended.seconds < 2.0 and ended.memory < 2**30


def test_mutated_files_are_refused_or_read_as_they_were(tmp_path, state):
    assert mutated(tmp_path, state, 12, seed=1)[4] > 8


@pytest.mark.faults
@pytest.mark.parametrize("part", range(10))
def test_five_thousand_mutated_files(tmp_path, state, figure, part):
    """Five hundred of the five thousand."""
    codes = mutated(tmp_path, state, 500, seed=2 + part)
    figure(f"exit codes {codes}")
    assert codes[4] > 400
