#!/bin/sh
# Guess: a reader of HDF5 that finds the signature behind a user block, as the specification has it, also adds
#   its length to every address of data; else it fails.
# Version: pyfive 1.3.0, h5py 3.16.0, numpy 2.4.6.
# Behaviour: names, shapes and types are right, and the numbers of contiguous datasets are taken from as many
#   bytes before their place as the user block is long. Nothing is raised. With the oldest layout (h5py's
#   default) it raises AssertionError.
# What to do: read such files by h5py or netCDF4.
# Seen:
#   user block    0: x = [0.5 1.5 2.5], energy = 3.25
#   user block  512: x = [0. 0. 0.], energy = 0.0
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 h5py==3.16.0 pyfive==1.3.0
cat > see.py <<'E'
import h5py
import numpy as np
import pyfive

wrong = []
for block in (0, 512):
    name = f"block-{block}.h5"
    with h5py.File(name, "w", libver="latest", userblock_size=block) as file:
        file["x"] = np.array([0.5, 1.5, 2.5])
        file["energy"] = 3.25
    with h5py.File(name) as file:
        assert file["energy"][()] == 3.25
    with pyfive.File(name) as file:
        x, energy = file["x"][:], file["energy"][()]
    print(f"user block {block:4d}: x = {x}, energy = {energy}")
    wrong.append(bool(energy != 3.25 and not np.array_equal(x, [0.5, 1.5, 2.5])))
if wrong != [False, True]:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py
