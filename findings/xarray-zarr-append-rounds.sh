#!/bin/sh
# Guess: a width 2.5 that Dataset.to_zarr(append_dim=...) appends to a store begun with the widths 1 and 2 is read back
#   as 2.5, or the call raises: for text longer than that of the store it does, "Mismatched dtypes".
# Version: xarray 2026.9.0, zarr 3.1.6, numpy 2.4.6.
# Behaviour: numbers are cast to the type that the store began with. Widths written as [1, 2] are integers, and
#   2.5 becomes a second 2 and 0.7 becomes 1, in coordinates and in data. All that is said is a warning that
#   integers have no value for NaN. A store begun with float32 stays so without any warning.
# What to do: make every column of numbers float64 before the first write; compare what is read back.
# Seen:
#   store begun with  appended           read back
#   int64             [2.5, 0.7]         [1.0, 2.0, 2.0, 1.0]
#   float32           [0.1]              [1.0, 2.0, 0.10000000149011612]
#   text of 2         text of 6          ValueError
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 xarray==2026.9.0 zarr==3.1.6
cat > see.py <<'E'
import warnings

import numpy as np
import xarray


def appended(name, first, then):
    """The coordinate after two writes, and what the second one warned of."""
    xarray.Dataset(coords={"half_width": first}).to_zarr(name, consolidated=False)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        xarray.Dataset(coords={"half_width": then}).to_zarr(name, append_dim="half_width", consolidated=False)
    values = xarray.open_zarr(name, consolidated=False)["half_width"].values
    return [float(value) for value in values], [str(warning.message) for warning in caught]


print("store begun with  appended           read back")
integers, said = appended("integers.zarr", [1, 2], [2.5, 0.7])
print(f"{'int64':16s}  {'[2.5, 0.7]':17s}  {integers}")
singles, silent = appended("singles.zarr", np.float32([1, 2]), [0.1])
print(f"{'float32':16s}  {'[0.1]':17s}  {singles}")
warnings.simplefilter("ignore")
try:
    appended("text.zarr", np.array(["ab"]), np.array(["abcdef"]))
    text = "no error"
except ValueError as error:
    text = type(error).__name__ if "Mismatched dtypes" in str(error) else str(error)
print(f"{'text of 2':16s}  {'text of 6':17s}  {text}")
as_recorded = (
    integers == [1.0, 2.0, 2.0, 1.0]
    and len(said) == 1
    and "_FillValue to use for NaNs" in said[0]
    and singles == [1.0, 2.0, float(np.float32(0.1))]
    and not silent
    and text == "ValueError"
)
if not as_recorded:
    raise SystemExit("changed: not as recorded")
E
v/bin/python see.py
