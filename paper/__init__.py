"""Chapter 3 of Koldaev (2022) made anew, with every claim checked, and the studies of everted bands.

`make paper` makes all figures and the table, `make figure-3.8` one. What is drawn and said of each is in
`figures`, what is checked in `claims`, the published numbers in `table`, the studies' configs in `families`.
"""
