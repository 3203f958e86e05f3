#!/bin/sh
# Guess: an HDF5 dataset compressed by SZ3 with absolute=1e-6 gives NaN where NaN was written, as one compressed by its
#   forerunner SZ does; or it cannot be written. The documentation of hdf5plugin says of this mode: "It ensures that the
#   resulting values will be within the provided absolute tolerance."
# Version: hdf5plugin 7.1.0, h5py 3.16.0, numpy 2.4.6.
# Behaviour: NaN comes back as some number, -2147.28 here, 2000 times the largest of the field. The next one comes back
#   as -1074 and -2752: what each is depends on its neighbours. The other values, infinity too, are right. There
#   is no message: a point that was left out, or a step that failed, has become data.
# What to do: write a mask beside it; or use SZ, or a lossless filter.
# Seen (points 9, 10, 11, 500 and 501; the largest error of the others):
#   written      0.179207  nan       0.218445  nan       nan
#   SZ3          0.179207  -2147.28  0.218445  -1074.29  -2752.03   error below 1e-6
#   SZ           0.179207  nan       0.218445  nan       nan        error below 1e-6
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 h5py==3.16.0 hdf5plugin==7.1.0
cat > see.py <<'E'
import warnings

import h5py
import hdf5plugin
import numpy as np

warnings.simplefilter("ignore")  # hdf5plugin says that SZ is old
written = np.sin(np.linspace(0, 20, 1000))
written[[10, 500, 501]] = np.nan
written[700] = np.inf
finite = np.isfinite(written)


def row(name, values):
    shown = "".join(f"  {text:8s}" for text in (f"{value:.6g}" for value in values[[9, 10, 11, 500, 501]]))
    return f"{name:11s}{shown}".rstrip()


print(row("written", written))
seen = {}
for name, options in (("SZ3", hdf5plugin.SZ3(absolute=1e-6)), ("SZ", hdf5plugin.SZ(absolute=1e-6))):
    with h5py.File("run.h5", "w") as file:
        file.create_dataset("bend", data=written, chunks=written.shape, **options)
    with h5py.File("run.h5") as file:
        read = file["bend"][...]
    within = bool(np.isinf(read[700]) and abs(read - written)[finite].max() < 1e-6)
    print(f"{row(name, read):63s}", "error below 1e-6" if within else "error above 1e-6")
    seen[name] = (within, int(np.isnan(read).sum()), bool(abs(read[[10, 500, 501]]).min() > 1000))
if seen != {"SZ3": (True, 0, True), "SZ": (True, 3, False)}:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py
