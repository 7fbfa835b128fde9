"""MATLAB files of versions 5 and 7.3: sizes, variables, and the addresses by which source files name them."""
