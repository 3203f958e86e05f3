"""State files: a record to the bytes of an HDF5 file, and back with every check.

The file is made as an image in memory: the HDF5 library never touches a file on disk, and whether one is
whole is decided by whoever writes and hashes its bytes. h5py is imported where it is used: listings do
without it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from ribbon_cli.errors import StoreError
from ribbon_cli.store.content import values_sha256
from ribbon_cli.store.fields import Field, assemble, flatten, value_dtype
from ribbon_cli.store.layout import FORMAT, FORMAT_VERSION
from ribbon_cli.store.record import StateRecord

if TYPE_CHECKING:
    import h5py

    from ribbon_cli.store.fields import Value

COMPRESS_ABOVE = 64
"""Arrays of more elements are compressed; below, the filter costs more than it saves."""
GZIP_LEVEL = 4
MAX_BYTES = 2**30
"""Largest state file, and largest sum of its datasets once unpacked, that is read."""
MAX_OBJECTS = 10_000
"""Most groups and datasets that are visited; links may form a loop."""
_FILTERS = {1, 2, 3}  # deflate, shuffle, fletcher32: all built in, so that no plug-in is ever loaded
_UNREADABLE = (
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
    import h5py
    from h5py import h5f, h5p

    fields = flatten(record)
    creation = h5p.create(h5p.FILE_CREATE)
    creation.set_obj_track_times(False)
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fapl_core(1 << 18, False)
    # A fixed pair of bounds fixes the bytes; v110 checksums its metadata and every HDF5 since 2016 reads it.
    access.set_libver_bounds(h5f.LIBVER_V110, h5f.LIBVER_V110)
    with h5py.File(h5f.create(b"state", h5f.ACC_TRUNC, creation, access)) as file:
        content = values_sha256({field.item.path: field.value for field in fields})
        root = {"format": FORMAT, "format_version": FORMAT_VERSION, "content_sha256": content}
        for name, text in root.items():
            _write_text_attribute(file.id, name, text)
        _write_groups(file, fields)
        for field in fields:
            _write_dataset(file, field)
        file.flush()
        return bytes(file.id.get_file_image())


def _write_groups(file: h5py.File, fields: list[Field]) -> None:
    """Create the groups of all paths, without times."""
    from h5py import h5g, h5p

    creation = h5p.create(h5p.GROUP_CREATE)
    creation.set_obj_track_times(False)
    done = {""}
    for field in fields:
        parts = field.item.path.split("/")[1:-1]
        for depth in range(1, len(parts) + 1):
            path = "/".join(parts[:depth])
            if path not in done:
                done.add(path)
                h5g.create(file.id, path.encode(), gcpl=creation)


def _write_text_attribute(owner: Any, name: str, text: str) -> None:
    """Write a fixed-length UTF-8 attribute; the low level is several times faster than h5py's own."""
    import numpy as np
    from h5py import h5a, h5s, h5t

    data = np.array(text.encode() or b"\0", dtype=np.bytes_)
    kind = h5t.C_S1.copy()
    kind.set_size(data.dtype.itemsize)
    kind.set_strpad(h5t.STR_NULLPAD)
    kind.set_cset(h5t.CSET_UTF8)
    h5a.create(owner, name.encode(), kind, h5s.create(h5s.SCALAR)).write(data, mtype=kind)


def _write_dataset(file: h5py.File, field: Field) -> None:
    """Write one dataset with its three attributes; arrays are checksummed, longer ones compressed."""
    import h5py
    import numpy as np

    value = field.value
    if isinstance(value, str | tuple):
        texts = [text.encode() for text in ((value,) if isinstance(value, str) else value)]
        width = max([1, *map(len, texts)])
        data = np.array(texts, dtype=h5py.string_dtype("utf-8", width))
        data = data.reshape(()) if isinstance(value, str) else data
    else:
        data = value
    options: dict[str, Any] = {}
    if data.shape and data.size:
        options = {"chunks": data.shape, "fletcher32": True}
        if data.size > COMPRESS_ABOVE:
            options |= {"compression": "gzip", "compression_opts": GZIP_LEVEL, "shuffle": True}
    dataset = file.create_dataset(field.item.path, data=data, dtype=data.dtype, track_times=False, **options)
    for name in ("description", "units", "equation"):
        _write_text_attribute(dataset.id, name, getattr(field.item, name))


def decode(path: str | Path) -> StateRecord:
    """Read a state file.

    Raises StoreError, one line that names the file, when it is missing, damaged, of a newer major version
    or not a state file at all.
    """
    return decode_bytes(read_bytes(path), str(path))


def read_bytes(path: str | Path) -> bytes:
    """Return a file's bytes. Raises StoreError when it cannot be read or is larger than any state file."""
    try:
        with open(path, "rb") as file:
            data = file.read(MAX_BYTES + 1)
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
        with h5py.File(h5f.open_file_image(data)) as file:
            stored = _check_root(file, source)
            values = _read_values(file)
            if values_sha256(values) != stored:
                raise ValueError("its content does not match its content_sha256")
            return assemble(values)
    except _UNREADABLE as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise StoreError(f"{source}: damaged, or not a state file: {reason}") from error


def _check_root(file: h5py.File, source: str) -> str:
    """Check format and version; return the stored content hash. Raises StoreError or ValueError."""
    name = _text_attribute(file, "format")
    version = _text_attribute(file, "format_version")
    if name != FORMAT:
        raise ValueError(f"its format is {name!r}, not {FORMAT!r}")
    major, _, _ = version.partition(".")
    if int(major) > int(FORMAT_VERSION.partition(".")[0]):
        raise StoreError(f"{source}: written in format {version}, newer than {FORMAT_VERSION}: update ribbon")
    return _text_attribute(file, "content_sha256")


def _text_attribute(file: h5py.File, name: str) -> str:
    """Read a root attribute. Raises ValueError unless it is one short fixed-length text."""
    if name not in file.attrs:
        raise ValueError(f"the root attribute {name!r} is missing")
    attribute = file.attrs.get_id(name)
    if attribute.shape != () or attribute.dtype.kind != "S" or attribute.dtype.itemsize > 256:
        raise ValueError(f"the root attribute {name!r} is not a short text")
    value = file.attrs[name]
    return value.decode() if isinstance(value, bytes) else str(value)


def _read_values(file: h5py.File) -> dict[str, Value]:
    """Read every dataset of a file. Raises ValueError for whatever a state file must not contain."""
    datasets = _find_datasets(file)
    size = sum(dataset.size * dataset.dtype.itemsize for dataset in datasets.values())
    if size > MAX_BYTES:
        raise ValueError(f"its datasets take {size} bytes, more than any state's")
    return {path: _read_dataset(dataset) for path, dataset in datasets.items()}


def _find_datasets(file: h5py.File) -> dict[str, h5py.Dataset]:
    """Walk over hard links only, so that a file can never make us read another. Raises ValueError."""
    import h5py

    found: dict[str, h5py.Dataset] = {}
    groups: list[tuple[str, h5py.Group]] = [("", file)]
    visited = 0
    while groups:
        prefix, group = groups.pop()
        for name in group:
            path = f"{prefix}/{name}"
            visited += 1
            if visited > MAX_OBJECTS:
                raise ValueError("it holds more objects than any state file")
            if not isinstance(group.get(name, getlink=True), h5py.HardLink):
                raise ValueError(f"{path} is a soft or external link")
            node = group[name]
            if isinstance(node, h5py.Group):
                groups.append((path, node))
            elif isinstance(node, h5py.Dataset):
                _check_dataset(path, node)
                found[path] = node
            else:
                raise ValueError(f"{path} is neither group nor dataset")
    return found


def _check_dataset(path: str, dataset: h5py.Dataset) -> None:
    """Refuse data stored outside the file, other filters and other types, before any is read."""
    creation = dataset.id.get_create_plist()
    if creation.get_external_count() or dataset.is_virtual:
        raise ValueError(f"{path} keeps its data outside the file")
    if not {creation.get_filter(k)[0] for k in range(creation.get_nfilters())} <= _FILTERS:
        raise ValueError(f"{path} uses a filter that no state file uses")
    if dataset.shape is None:
        raise ValueError(f"{path} has no shape")
    if dataset.dtype.kind != "S" and dataset.dtype not in ("<f8", "<i8", "?"):
        raise ValueError(f"{path} has dtype {dataset.dtype}")


def _read_dataset(dataset: h5py.Dataset) -> Value:
    """Read one checked dataset as a value of fields.py."""
    import numpy as np

    data = np.asarray(dataset[()])
    if data.dtype.kind != "S":
        if data.dtype == "?" and not (data.view(np.uint8) <= 1).all():
            raise ValueError(f"{dataset.name} holds a truth value other than 0 and 1")
        value_dtype(data)
        return data
    texts = tuple(bytes(text).decode() for text in data.ravel().tolist())
    if data.ndim > 1:
        raise ValueError(f"{dataset.name} is an array of texts with more than one dimension")
    return texts if data.ndim else texts[0]
