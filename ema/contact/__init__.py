"""Friction at contacts: laws, their increments, and their solution against a given compliance.

It knows no structure and no time loop: a solver gives compliance and displacements, and takes forces.
"""
