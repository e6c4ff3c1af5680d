"""The door: foreign files, foreign units, FE matrices, live rigs."""
