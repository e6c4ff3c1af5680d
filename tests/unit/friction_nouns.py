"""A placement, a ring-down and loops with known numbers, made in a moment."""

import numpy as np

from ema.data import Decay, Finding, Geometry, Loop
from ema.data.placement import (
    Candidates,
    ControlLine,
    ControlStudy,
    FrictionBeam,
    Place,
    Placement,
    Prediction,
    Ranking,
)

LEVELS, FORCES = np.array([10.0, 40.0]), np.array([50.0, 100.0, 200.0])


def placement(geometry: Geometry | None = None, warning: str = "", across: int = 5) -> Placement:
    """``across`` times 3 places of one beam; the last but one candidate is best, with F_N = 123 N."""
    x, y = np.meshgrid(np.linspace(0.2, 1.0, across), np.linspace(0.2, 0.6, 3), indexing="ij")
    count = x.size
    beam = FrictionBeam(0.3, 0.06, 0.05, overhang=0.02, name="steel 60 x 50")
    candidates = Candidates(np.stack([x.ravel(), y.ravel()], 1), np.zeros(count), np.zeros(count, int), (beam,))
    shape = (count, 1, len(LEVELS), len(FORCES))
    damping = np.broadcast_to(0.01 + 0.0005 * np.arange(count)[:, None, None, None], shape)
    prediction = Prediction(
        candidates,
        (0,),
        np.array([499.0]),
        np.array([0.00638]),
        LEVELS,
        FORCES,
        np.full(shape, 505.0),
        damping,
        np.full(shape, 1e6),
        np.full(shape, 2.0),
        np.array([0.1]),
        np.array([0.08]),
    )
    best = count - 2
    ranked = [best, 0, 3]
    places = tuple(
        Place(
            one,
            (float(candidates.centres[one, 0]), float(candidates.centres[one, 1])),
            0.0,
            beam.name,
            0.019 - 0.002 * rank,
            0.015,
            0.02,
            123.0 - 10 * rank,
            np.array([110.0, 140.0]),
            np.array([[507.0, 503.0]]),
            np.array([[0.0211, 0.0187]]),
            np.array([[0.0180, 0.0150]]),
            np.array([[0.0230, 0.0200]]),
            np.array([-6.0]),
            np.array([10.5]),
            (Finding("warning", "near-edge", "place", "close to the edge."),),
            "all modes",
        )
        for rank, one in enumerate(ranked)
    )
    ranking = Ranking(
        "damping, least over the force levels",
        prediction,
        0.01 + 0.0005 * np.arange(count),
        places,
        shortlist=tuple(ranked),
    )
    times = np.linspace(0, 0.1, 50)
    lines = tuple(
        ControlLine(law, force, energy, 0.07, 0.09, times, np.exp(-times / energy))
        for law, force, energy in (("constant", 120.0, 0.012), ("on-off", 60.0, 0.010))
    )
    control = ControlStudy(
        best,
        0,
        200.0,
        lines,
        LEVELS,
        np.array([0.0187, 0.0187]),
        np.array([0.0211, 0.0199]),
        "A controlled force removes the energy 17 % faster.",
    )
    return Placement(
        "Beam on the table",
        ranking,
        np.zeros(3),
        np.eye(3),
        np.array([[0.0, 1.2], [0.0, 0.8]]),
        np.stack([x.ravel(), y.ravel()], 1),
        (np.array([[0.5, 0.3], [0.7, 0.3], [0.7, 0.5]]),),
        warning,
        control,
        (Finding("info", "not-compared", "joint", "the joint model was not held against a measurement."),),
        geometry=geometry,
    )


def decay(name: str = "release 1") -> Decay:
    """It slides at 16.7 Hz with a straight envelope for 0.5 s, then sticks at 31.6 Hz with 0.1 % damping."""
    times = np.arange(0.0, 2.0, 1e-3)
    sliding = times < 0.5
    after = times - 0.5
    amplitudes = np.where(sliding, 1e-3 * (1 - 1.8 * times), 1e-4 * np.exp(-0.001 * 2 * np.pi * 31.6 * after))
    return Decay(times, amplitudes, np.where(sliding, 16.7, 31.6), np.where(sliding, 0.043, 0.001), 0.5, name)


def loop(normal_force: float, name: str = "", friction: float = 0.2, stiffness: float = 2e7) -> Loop:
    """The parallelogram of a Jenkins element at 20 µm."""
    slip, reach = friction * normal_force, 2e-5
    play = 2 * slip / stiffness
    x = np.array([-reach, -reach + play, reach, reach - play, -reach])
    area = 4 * slip * (reach - slip / stiffness)
    return Loop(x, slip * np.array([-1.0, 1.0, 1.0, -1.0, -1.0]), area, reach, 1, normal_force, name=name)
