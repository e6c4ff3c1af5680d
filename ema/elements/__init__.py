"""Matrices of structures given by their dimensions: beams, plates, and two beams pressed together.

What the simulator works on and what a model file describes; so it lies below both.
"""

from ema.elements.beams import Section, beam, element, stepped_beam
from ema.elements.double import double_beam
from ema.elements.plates import Plate, plate_matrices

__all__ = ["Plate", "Section", "beam", "double_beam", "element", "plate_matrices", "stepped_beam"]
