"""The figures and tables of chapter 3 of Koldaev (2022), made anew, with every claim checked.

`make paper` makes all of them, `make figure-3.8` one. What is drawn and said of each is in `figures`, what is
checked in `claims`.
"""
