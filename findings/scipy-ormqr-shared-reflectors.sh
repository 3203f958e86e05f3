#!/bin/sh
# Guess: a function of scipy.linalg.lapack that multiplies by the Q of a QR factorisation only reads the reflectors: its
#   signature has them as input, and only `c` as something that may be overwritten. So threads may share one
#   factorisation.
# Version: scipy 1.17.1, numpy 2.4.6.
# Behaviour: LAPACK puts a 1 on the diagonal of the reflectors while it applies each of them, and puts the old number
#   back; scipy hands over the array itself, without Python's lock. Whoever multiplies meanwhile has a wrong product, and
#   may put the 1 back for good: then the factorisation stays wrong for all calls that follow. There is no message.
#   By one thread at a time everything is right.
# What to do: give each call a copy of the reflectors, which are few numbers; or a lock.
# Seen (six reflectors of 400 numbers on 400 columns; the numbers of wrong products differ from time to time):
#   one thread     0 of 300 products wrong
#   four threads   5 of 1200 products wrong, by up to 1212.9
#   qr[0, 0]       -20.2843 before; as other threads see it -20.2843 and 1.0
#   reflectors afterwards as before: no
set -eu
dir=$(mktemp -d)
trap 'rm -rf "$dir"' EXIT
cd "$dir"
python3 -m venv v
v/bin/pip -qq install numpy==2.4.6 scipy==1.17.1
cat > see.py <<'E'
import threading

import numpy as np
import scipy

rng = np.random.default_rng(0)
(qr, tau), _ = scipy.linalg.qr(rng.normal(size=(400, 6)), mode="raw")
before = qr.copy()
columns = np.asfortranarray(rng.normal(size=(400, 400)))
multiply = scipy.linalg.get_lapack_funcs("ormqr", (qr,))


def product():
    return multiply("L", "N", qr, tau, columns, 64 * 400)[0]


right = product()
alone = sum(not np.array_equal(product(), right) for _ in range(300))
wrong, seen = [], set()


def work():
    for _ in range(300):
        off = float(abs(product() - right).max())
        if off:
            wrong.append(off)


threads = [threading.Thread(target=work) for _ in range(4)]
for thread in threads:
    thread.start()
while any(thread.is_alive() for thread in threads):
    seen.add(float(qr[0, 0]))
for thread in threads:
    thread.join()
print(f"one thread     {alone} of 300 products wrong")
print(f"four threads   {len(wrong)} of 1200 products wrong, by up to {max(wrong, default=0.0):.1f}")
print(f"qr[0, 0]       {before[0, 0]:.4f} before; as other threads see it", " and ".join(f"{v:.6}" for v in sorted(seen)))
print("reflectors afterwards as before:", "yes" if np.array_equal(qr, before) else "no")
if alone or 1.0 not in seen:
    raise SystemExit("changed: not as recorded")
E
OPENBLAS_NUM_THREADS=1 v/bin/python see.py
