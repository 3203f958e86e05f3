"""Is the program the same as at a given commit? Both are run on the same cases, and compared byte by byte.

`make same-as COMMIT=...` and `python -m bench.same`. The cases are in `cases.yaml`. Nothing here imports the
package: a build whose package is laid out otherwise can be compared too.
"""
