"""State files: from a record to the bytes of an HDF5 file, and back with all checks.

The file is made as an image in memory. The HDF5 library never touches a file on disk; whoever writes and
hashes the bytes decides whether they are whole. h5py is imported where it is used: listings do
without it.
"""

from __future__ import annotations

import io
import math
import os
import stat
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ribbon_cli.doors import Later
from ribbon_cli.errors import StoreError
from ribbon_cli.store.atomic import without_waiting
from ribbon_cli.store.layout import DIMENSIONS, EVENTS, FORMAT, FORMAT_VERSION, KINDS_OF_EVENTS, SIGNALS
from ribbon_cli.store.preamble import block_size, check_seal, check_version, head_version, refuse_newer, seal
from ribbon_cli.store.summaries import Summary
from ribbon_cli.text import in_a_line

if TYPE_CHECKING:
    import h5py
    import numpy as np

    from ribbon_cli.store import content, fields
    from ribbon_cli.store.fields import Value
    from ribbon_cli.store.layout import Item
    from ribbon_cli.store.record import StateRecord
else:  # what listings do without
    content, fields = Later("ribbon_cli.store.content"), Later("ribbon_cli.store.fields")

COMPRESS_ABOVE = 64
"""Arrays of more elements are compressed; below, the filter costs more than it saves."""
GZIP_LEVEL = 4
MAX_BYTES = 2**31
"""Largest state file, and largest sum of its datasets once unpacked, that is read: N = 1 000 000 with 12
modes in two metrics fits."""
PACK = "ribbon-pack"
"""The format that packed runs name."""
MAX_OBJECTS = 1000
"""Most groups and datasets that are visited; a state has less than a hundred."""
MOST_OF_KINDS = 2**20
"""Largest size in bytes of the kinds of a state's events."""
_OF_ANY_WIDTH = {"kind", "stage", "status", "message", "method", "parent_ref"}
"""Texts whose width differs from state to state; other texts are nearly equal throughout a run."""
_FILTERS = {1, 2, 3}  # deflate, shuffle, fletcher32: all built in, so that no plug-in is ever loaded
UNREADABLE = (
    OSError,
    RuntimeError,
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    AttributeError,
    NotImplementedError,
    OverflowError,
    MemoryError,
)
"""What h5py and NumPy raise on damaged files."""


def encode(record: StateRecord) -> bytes:
    """Return the bytes of the record's state file; the same record gives the same bytes.

    Raises ValueError where a field does not fit layout.py.
    """
    return encoded(record)[0]


def encoded(record: StateRecord) -> tuple[bytes, Summary]:
    """The bytes of the record's state file, and its summary with the content hash. Raises as `encode`."""
    from h5py import h5d

    found = fields.flatten(record)
    _check_kinds(record)
    digest = content.values_sha256({field.item.path: field.value for field in found})
    summary = Summary.of(record, digest)
    head = summary.to_dict()
    found += fields.scales(found, record.length, record.segments)
    fixed = [field for field in found if field.item.field not in _OF_ANY_WIDTH]
    others = [field for field in found if field.item.field in _OF_ANY_WIDTH]
    datasets = tuple((field.item, *_kind(field.value)) for field in fixed)
    blank, places = _blank(block_size(head), datasets, record.length / record.segments)
    image = io.BytesIO(blank)
    for field in fixed:
        if field.item in places:
            image.seek(places[field.item])
            image.write(_in_memory(field.value)[1].tobytes())
    with _file_in(image) as file:
        _overwrite_text_attribute(file, "content_sha256", digest)
        for field in fixed:
            if field.item in places or field.item.field in DIMENSIONS:
                continue
            dataset = h5d.open(file.id, field.item.path.encode())
            _write_values(dataset, field.value)
            if field.item.path == EVENTS and record.event_kinds:
                write_text_attribute(dataset, KINDS_OF_EVENTS, " ".join(record.event_kinds))
        for field in others:
            _write_values(_create_dataset(file, field.item, *_kind(field.value)), field.value)
    return seal(image.getvalue(), head), summary


@lru_cache(maxsize=16)
def _blank(
    block: int, datasets: tuple[tuple[Item, Any, tuple[int, ...]], ...], h: float
) -> tuple[bytes, dict[Item, int]]:
    """A state file without values but for its scales, and without the texts that are of another width in each
    state.

    Groups, datasets and their attributes are the same in most states of a run, and to make them takes
    longer than to fill them. So are scales where facets have the same length h. Single values lie in the file
    as they are: also where each of them goes.
    """
    image = io.BytesIO()
    with _file_in(image, block) as file:
        root = {"format": FORMAT, "format_version": FORMAT_VERSION, "content_sha256": "0" * 64}
        for name, text in root.items():
            write_text_attribute(file.id, name, text)
        _write_groups(file, [item for item, _, _ in datasets])
        made = {item: _create_dataset(file, item, kind, shape) for item, kind, shape in datasets}
        for item, _, shape in datasets:
            if item.field in DIMENSIONS:
                _write_values(made[item], fields.scale(item.field, shape[0], h))
        _write_axes(file, made)
        places = {item: made[item].get_offset() for item, _, shape in datasets if not shape}
        made.clear()  # what is still open when the file is closed takes h5py longer
    return image.getvalue(), places


def _file_in(image: io.BytesIO, block: int | None = None) -> h5py.File:
    """Open an HDF5 file in memory; with the size of a user block, create one.

    It is not the core driver's image: HDF5 before 1.14 hands that out with a superblock whose checksum is
    not its own.
    """
    import h5py
    from h5py import h5f, h5fd, h5p

    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fileobj_driver(h5fd.fileobj_driver, image)
    # A fixed pair of bounds fixes the bytes; v110 checksums its metadata and every HDF5 since 2016 reads it.
    access.set_libver_bounds(h5f.LIBVER_V110, h5f.LIBVER_V110)
    if block is None:
        return h5py.File(h5f.open(b"state", h5f.ACC_RDWR, access))
    creation = h5p.create(h5p.FILE_CREATE)
    creation.set_userblock(block)
    creation.set_obj_track_times(False)
    return h5py.File(h5f.create(b"state", h5f.ACC_TRUNC, creation, access))


def _write_axes(file: h5py.File, datasets: Mapping[Item, Any]) -> None:
    """Make the scales dimension scales, attach them, and say what a viewer is to show of each group."""
    from h5py import h5ds

    by_path = {item.path: dataset for item, dataset in datasets.items()}
    for item, dataset in datasets.items():
        if item.field in DIMENSIONS:
            h5ds.set_scale(dataset, item.field.encode())
    for item, dataset in datasets.items():
        if item.field in DIMENSIONS:
            continue
        for axis, dim in enumerate(item.dims):
            h5ds.attach_scale(dataset, by_path[f"{item.group}/{dim}"], axis)
        if SIGNALS.get(item.group) == item.field:
            group = file[item.group].id
            write_text_attribute(group, "NX_class", "NXdata")
            write_text_attribute(group, "signal", item.field)
            write_text_attribute(group, "axes", *item.dims)


def _write_groups(file: h5py.File, items: list[Item]) -> None:
    """Create the groups of all paths, without times."""
    from h5py import h5g, h5p

    creation = h5p.create(h5p.GROUP_CREATE)
    creation.set_obj_track_times(False)
    done = {""}
    for item in items:
        parts = item.path.split("/")[1:-1]
        for depth in range(1, len(parts) + 1):
            path = "/".join(parts[:depth])
            if path not in done:
                done.add(path)
                h5g.create(file.id, path.encode(), gcpl=creation)


def write_text_attribute(owner: Any, name: str, *texts: str) -> None:
    """Write a fixed-length UTF-8 attribute, of several texts an array; faster than h5py's own by several
    times.
    """
    from h5py import h5a

    kind, space, data = _text_value(texts)
    h5a.create(owner, name.encode(), kind, space).write(data, mtype=kind)


# Types, spaces and properties are the same from file to file. Making each anew takes longer than writing.


@lru_cache(maxsize=1024)
def _text_value(texts: tuple[str, ...]) -> tuple[Any, Any, Any]:
    """HDF5's type and space of an attribute, and its data."""
    import numpy as np

    data = np.array([text.encode() or b"\0" for text in texts], dtype=np.bytes_)
    data = data.reshape(data.shape if len(texts) > 1 else ())
    return _text_type(data.dtype.itemsize), _space(data.shape), data


@lru_cache(maxsize=256)
def _text_type(width: int) -> Any:
    """HDF5's type of null-padded UTF-8 texts."""
    from h5py import h5t

    kind = h5t.C_S1.copy()
    kind.set_size(width)
    kind.set_strpad(h5t.STR_NULLPAD)
    kind.set_cset(h5t.CSET_UTF8)
    return kind


@lru_cache(maxsize=256)
def _space(shape: tuple[int, ...]) -> Any:
    """HDF5's space of an array, or of one value."""
    from h5py import h5s

    return h5s.create_simple(shape) if shape else h5s.create(h5s.SCALAR)


@lru_cache(maxsize=16)
def _number_type(dtype: Any) -> Any:
    """HDF5's type of numbers and truth values."""
    from h5py import h5t

    return h5t.py_create(dtype, logical=True)


@lru_cache(maxsize=256)
def _creation(shape: tuple[int, ...], compressed: bool) -> Any:
    """How a dataset is laid out: an array in one chunk with a checksum, a single value as it is."""
    from h5py import h5d, h5p

    creation = h5p.create(h5p.DATASET_CREATE)
    creation.set_obj_track_times(False)
    if not shape:
        creation.set_alloc_time(h5d.ALLOC_TIME_EARLY)  # so that its place is known before there is a value
    if all(shape) and shape:
        creation.set_chunk(shape)
        if compressed:
            creation.set_shuffle()
            creation.set_deflate(GZIP_LEVEL)
        creation.set_fletcher32()
    return creation


def _kind(value: Value) -> tuple[Any, tuple[int, ...]]:
    """Type and shape of a value's dataset; a text's type is the width in bytes of the longest."""
    if isinstance(value, str):
        return max(1, len(value.encode())), ()
    if isinstance(value, tuple):
        return max([1, *(len(text.encode()) for text in value)]), (len(value),)
    return value.dtype, value.shape


def _create_dataset(file: h5py.File, item: Item, kind: Any, shape: tuple[int, ...]) -> Any:
    """Make a dataset with its three attributes and return its id; arrays are checksummed, longer ones
    compressed.
    """
    from h5py import h5d

    of_file = _text_type(kind) if isinstance(kind, int) else _number_type(kind)
    creation = _creation(shape, math.prod(shape) > COMPRESS_ABOVE)
    dataset = h5d.create(file.id, item.path.encode(), of_file, _space(shape), creation)
    for name in ("description", "units", "equation"):
        write_text_attribute(dataset, name, getattr(item, name))
    return dataset


def _in_memory(value: Value) -> tuple[Any, Any]:
    """HDF5's type of a value, and its data."""
    import numpy as np

    kind, shape = _kind(value)
    if not isinstance(value, str | tuple):
        return _number_type(kind), value
    memory = _text_type(kind)
    texts = [text.encode() for text in ((value,) if isinstance(value, str) else value)]
    return memory, np.array(texts, dtype=memory.dtype).reshape(shape)


def _write_values(dataset: Any, value: Value) -> None:
    """Write all of a dataset."""
    from h5py import h5s

    memory, data = _in_memory(value)
    if data.size:
        dataset.write(h5s.ALL, h5s.ALL, data, mtype=memory)


def _overwrite_text_attribute(file: h5py.File, name: str, text: str) -> None:
    """Write another text of the same width into a root attribute."""
    from h5py import h5a

    kind, _, data = _text_value((text,))
    h5a.open(file.id, name.encode()).write(data, mtype=kind)


def decode(path: str | Path) -> StateRecord:
    """Read a state file.

    Raises StoreError, one line that names the file, when it is missing, damaged, of a newer major version
    or not a state file at all.
    """
    return decode_bytes(read_bytes(path), str(path))


def read_bytes(path: str | Path) -> bytes:
    """Return a file's bytes. Raises StoreError when it cannot be read or is larger than any state file."""
    try:
        descriptor = without_waiting(path, os.O_RDONLY | os.O_CLOEXEC)  # thousands of files: `open` is slower
        try:
            found = os.fstat(descriptor)
            if not stat.S_ISREG(found.st_mode):
                raise StoreError(f"{path}: not a file")
            # Asked for more, Python would make room for it first.
            left = min(found.st_size, MAX_BYTES) + 1
            data = os.read(descriptor, left)
            while more := os.read(descriptor, left - len(data)):
                data += more
        finally:
            os.close(descriptor)
    except OSError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror}") from error
    if len(data) > MAX_BYTES:
        raise StoreError(f"{path}: larger than any state file ({MAX_BYTES} bytes)")
    return data


def decode_bytes(data: bytes, source: str) -> StateRecord:
    """Read a state file's bytes; `source` names them in messages. Raises StoreError as `decode` does."""
    import h5py
    from h5py import h5f

    try:
        check_version(data, source)
        head = check_seal(data)
        with h5py.File(h5f.open_file_image(data)) as file:
            stored = _check_root(file, source, head_version(data))
            values = _read_values(file)
            if content.values_sha256(values) != stored:
                raise ValueError("its content does not match its content_sha256")
            record = fields.assemble(values, _event_kinds(file) if EVENTS in values else None)
            _check_kinds(record)
            if head is not None and not Summary.of(record, stored).agrees(head):
                raise ValueError("the summary in its head is not that of its content")
            return record
    except UNREADABLE as error:
        raise StoreError(f"{source}: damaged, or not a state file: {in_a_line(error)}") from error


def _check_root(file: h5py.File, source: str, head: str | None) -> str:
    """Check format and version, and that only files of 1.0 lack a head; return the stored content hash.

    Raises StoreError or ValueError.
    """
    name = text_attribute(file, "format")
    version = text_attribute(file, "format_version")
    if name == PACK:
        raise StoreError(f"{source}: a packed run, not a state: `ribbon unpack` restores the run")
    if name != FORMAT:
        raise ValueError(f"its format is {name!r}, not {FORMAT!r}")
    refuse_newer(version, source)
    major, _, minor = version.partition(".")
    if head != (version if (int(major), int(minor)) > (1, 0) else None):
        raise ValueError("its head is missing, or of another version")
    return text_attribute(file, "content_sha256")


def _check_kinds(record: StateRecord) -> None:
    """Raise ValueError unless each event has a kind."""
    kinds = record.event_kinds or ()
    if len(kinds) != len(record.events) or any(kind.split() != [kind] for kind in kinds):
        raise ValueError(f"{len(record.events)} events have {len(kinds)} kinds, of one word each")


def _event_kinds(file: h5py.File) -> tuple[str, ...] | None:
    """The kinds of a state's events, None in a file of format 1.0 or 1.1. Raises ValueError."""
    from h5py import h5a, h5d

    events, name = h5d.open(file.id, EVENTS.encode()), KINDS_OF_EVENTS.encode()
    if not h5a.exists(events, name):
        return None
    return tuple(_read_text(h5a.open(events, name), MOST_OF_KINDS).split())


def text_attribute(file: h5py.File, name: str) -> str:
    """Read a root attribute. Raises ValueError unless it is one short fixed-length text."""
    if name not in file.attrs:
        raise ValueError(f"the root attribute {name!r} is missing")
    return _read_text(file.attrs.get_id(name))


def _read_text(attribute: h5py.h5a.AttrID, most: int = 256) -> str:
    """The text of an attribute. Raises ValueError unless it is one of fixed length, of `most` bytes."""
    import numpy as np

    if attribute.shape != () or attribute.dtype.kind != "S" or attribute.dtype.itemsize > most:
        raise ValueError(f"the attribute {attribute.name.decode()!r} is not a short text")
    value = np.empty((), attribute.dtype)
    attribute.read(value)
    return bytes(value.item()).decode()


def _read_values(file: h5py.File) -> dict[str, Value]:
    """Read every dataset of a file. Raises ValueError for whatever a state file must not contain."""
    import numpy as np

    arrays: dict[str, tuple[Any, np.ndarray]] = {}
    size = 0
    for path, dataset in _find_datasets(file).items():
        shape, dtype = check_dataset(path, dataset)
        size += math.prod(shape) * dtype.itemsize
        if size > MAX_BYTES:
            raise ValueError(f"its datasets take {size} bytes or more, more than any state's")
        arrays[path] = dataset, np.empty(shape, dtype)
    return {path: _read_dataset(path, dataset, data) for path, (dataset, data) in arrays.items()}


def _find_datasets(file: h5py.File) -> dict[str, Any]:
    """Ids of all datasets. Walks over hard links only, so that a file can never make us read another.

    h5py's objects would take three times as long as reading. Raises ValueError.
    """
    from h5py import h5d, h5g, h5l, h5o

    found: dict[str, h5d.DatasetID] = {}
    root = h5g.open(file.id, b"/")
    groups: list[tuple[str, h5g.GroupID]] = [("", root)]
    seen = {h5o.get_info(root).addr}
    while groups:
        prefix, group = groups.pop()
        for name in group:
            path = f"{prefix}/{name.decode()}"
            if len(seen) > MAX_OBJECTS:
                raise ValueError("it holds more objects than any state file")
            if group.links.get_info(name).type != h5l.TYPE_HARD:
                raise ValueError(f"{path} is a soft or external link")
            node = h5o.open(group, name)
            address = h5o.get_info(node).addr
            if address in seen:
                raise ValueError(f"{path} is another object once more, or leads in a circle")
            seen.add(address)
            if isinstance(node, h5g.GroupID):
                groups.append((path, node))
            elif isinstance(node, h5d.DatasetID):
                found[path] = node
            else:
                raise ValueError(f"{path} is neither group nor dataset")
    return found


def check_dataset(
    path: str, dataset: h5py.h5d.DatasetID, dtypes: tuple[str, ...] = ("<f8", "<i8", "?", "S")
) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Refuse data outside of the file, other filters and other types, before any is read.

    Returns shape and type. Raises ValueError.
    """
    from h5py import h5d, h5s

    creation = dataset.get_create_plist()
    if creation.get_external_count() or creation.get_layout() == h5d.VIRTUAL:
        raise ValueError(f"{path} keeps its data outside the file")
    if not {creation.get_filter(k)[0] for k in range(creation.get_nfilters())} <= _FILTERS:
        raise ValueError(f"{path} uses a filter that no state file uses")
    space = dataset.get_space()
    if space.get_simple_extent_type() == h5s.NULL:
        raise ValueError(f"{path} has no shape")
    dtype = dataset.dtype
    if dtype not in dtypes and not ("S" in dtypes and dtype.kind == "S"):
        raise ValueError(f"{path} has dtype {dtype}")
    return space.get_simple_extent_dims(), dtype


def _read_dataset(path: str, dataset: Any, data: np.ndarray) -> Value:
    """Read one checked dataset into an array of its shape and type, as a value of fields.py."""
    import numpy as np
    from h5py import h5s

    if data.size:
        dataset.read(h5s.ALL, h5s.ALL, data)
    if data.dtype.kind != "S":
        if data.dtype == "?" and not (data.view(np.uint8) <= 1).all():
            raise ValueError(f"{path} holds a truth value other than 0 and 1")
        fields.value_dtype(data)
        return data
    texts = tuple(bytes(text).decode() for text in data.ravel().tolist())
    if data.ndim > 1:
        raise ValueError(f"{path} is an array of texts with more than one dimension")
    return texts if data.ndim else texts[0]
