"""Small objects with known truth: what the examples in the documentation work on.

They are drawn in memory in a few milliseconds and stand for no real structure; campaigns with files are made by the
built-in studies.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from ema.data import (
    BeamModel,
    Campaign,
    Candidates,
    Channel,
    Condition,
    Decay,
    Excitation,
    Forecast,
    FrfSet,
    FrictionBeam,
    FrictionLaw,
    Geometry,
    Joint,
    JointForce,
    Matrices,
    ModalMap,
    ModalModel,
    Place,
    Placement,
    PoleTable,
    Prediction,
    Ranking,
    Recording,
    Run,
    RunResult,
    Source,
    StudyResult,
    Trial,
    Trials,
    poles_from,
)
from ema.dof import Dof
from ema.synthesis import frfs

RIG = """
[rig]
device = "virtual"
sampling_rate = 1024

[take]
trigger = "hammer > 20 N"
points = [1]
takes = 2

[[channels]]
name = "hammer"
role = "reference"
unit = "N"
dof = "{point}:+Z"

[[channels]]
name = "acc 1"
role = "response"
unit = "m/s^2"
dof = "1:+Z"
"""
"""A ``rig.toml`` for :func:`source`: two takes at one point."""


def modal_model() -> ModalModel:
    """Return three modes of a line of four points, 40, 60 and 90 Hz, with unit modal mass.

    Returns
    -------
    ModalModel
        Real shapes in 1/sqrt(kg) at ``1:+Z`` to ``4:+Z``, damping ratios of 1, 0.8 and 0.5 %, forces at ``1:+Z`` and
        ``2:+Z``.

    Examples
    --------
    >>> modal_model()
    ModalModel('line', 3 modes 40 to 90 Hz, damping 0.5 to 1 %, 4 DOFs, unit modal mass)
    """
    poles = poles_from(np.array([40.0, 60.0, 90.0]), np.array([0.010, 0.008, 0.005]))
    points = np.arange(1, 5) / 4.5
    shapes = np.column_stack([np.sin(order * np.pi * points) for order in (1, 2, 3)]) / np.sqrt(2)
    dofs = tuple(Dof(node, "+Z") for node in range(1, 5))
    # proportional damping, unit modal mass: R = psi psi^T / (2 j w_d)
    participation = shapes[:2] / (2j * poles.imag)
    return ModalModel(
        poles=poles,
        shapes=shapes.astype(complex),
        dofs=dofs,
        participation=participation,
        inputs=dofs[:2],
        scaling="unit modal mass",
        name="line",
    )


def frf_set(noise: float = 0.0) -> FrfSet:
    """Return the accelerances of :func:`modal_model` from 20 to 120 Hz in steps of 0.5 Hz.

    Parameters
    ----------
    noise : float, default 0.0
        Standard deviation of the complex noise over the rms of all values; its variance is in the set where it is
        above 0.

    Returns
    -------
    FrfSet
        201 lines, 4 outputs, 2 inputs.

    Examples
    --------
    >>> frf_set()
    FrfSet('line', 201 lines 20 to 120 Hz, 4 outputs x 2 inputs, accelerance [(m/s^2)/N], synthesis)
    """
    exact = frfs(modal_model(), np.arange(20.0, 120.25, 0.5), "accelerance")
    if not noise:
        return exact
    draw = np.random.default_rng(20).standard_normal((2, *exact.values.shape)) / np.sqrt(2)
    std = noise * np.sqrt(np.mean(np.abs(exact.values) ** 2))
    return replace(
        exact, values=exact.values + std * (draw[0] + 1j * draw[1]), variance=np.full(exact.values.shape, std**2)
    )


def recording(force: Float[np.ndarray, "sample"] | None = None) -> Recording:
    """Return force and acceleration of a mass of 2 kg on a spring, 40 Hz with 1 % damping, at 1024 Hz.

    Parameters
    ----------
    force : array of shape (sample,), optional
        Force [N]; by default one hammer impact in 2 s, a half sine of 4 ms and 100 N at 0.25 s.

    Returns
    -------
    Recording
        The force in the channel ``hammer``, the acceleration in ``acc 1``.

    Examples
    --------
    >>> recording()
    Recording('impact', 2 channels x 2048 samples, 1024 Hz, 2 s, channels hammer, acc 1)
    """
    rate, omega, zeta, mass = 1024.0, 2 * np.pi * 40.0, 0.01, 2.0
    if force is None:
        since = np.arange(2048) / rate - 0.25
        force = np.where((since >= 0) & (since <= 0.004), 100 * np.sin(np.pi * since / 0.004), 0.0)
    samples = len(force)
    times = np.arange(samples) / rate
    # impulse response of the acceleration without its direct term: h'' of h = e^(-zeta w t) sin(w_d t) / (m w_d)
    damped = omega * np.sqrt(1 - zeta**2)
    pole = -zeta * omega + 1j * damped
    kernel = np.imag(pole**2 * np.exp(pole * times)) / (mass * damped)
    spectrum = np.fft.rfft(force, 2 * samples) * np.fft.rfft(kernel, 2 * samples)
    acceleration = force / mass + np.fft.irfft(spectrum, 2 * samples)[:samples] / rate
    return Recording(
        signals=np.array([force, acceleration]),
        sampling_rate=rate,
        channels=(
            Channel("hammer", Dof(1, "+Z"), "force", "reference", "N"),
            Channel("acc 1", Dof(1, "+Z"), "acceleration", "response", "m/s^2"),
        ),
        name="impact",
    )


def source() -> Source:
    """Return a source that delivers three times the impact of :func:`recording`.

    Returns
    -------
    Source
        Its channels name no point: where the hammer struck is for the session to say.

    Examples
    --------
    >>> len(list(source().takes()))
    3
    """
    return _Records(replace(recording(), channels=tuple(replace(c, dof=None) for c in recording().channels)))


@dataclass(frozen=True)
class _Records:
    """A source of one record, three times."""

    record: Recording

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Those of the record."""
        return self.record.channels

    @property
    def sampling_rate(self) -> float:
        """That of the record in Hz."""
        return self.record.sampling_rate

    def takes(self) -> Iterator[Recording]:
        """Yield the record three times."""
        yield from (self.record,) * 3

    def close(self) -> None:
        """Do nothing: there is no hardware."""


def geometry() -> Geometry:
    """Return the four points of :func:`modal_model` on a line along X, 0.1 m apart.

    Returns
    -------
    Geometry
        Nodes 1 to 4 and the line through them.

    Examples
    --------
    >>> geometry()
    Geometry('line', 4 nodes, 1 line, 0 faces, 0.3 x 0 x 0 m)
    """
    xyz = np.column_stack([0.1 * np.arange(4), np.zeros(4), np.zeros(4)])
    return Geometry(nodes=np.arange(1, 5), xyz=xyz, lines=((1, 2, 3, 4),), name="line")


def plate() -> tuple[ModalModel, Geometry]:
    """Return three bending modes of a free steel plate of 0.6 x 0.4 x 0.006 m, measured at 35 points.

    Returns
    -------
    tuple of (ModalModel, Geometry)
        Shapes of unit modal mass at ``1:+Z`` to ``35:+Z``, damping ratios of 0.5 %, forces at ``1:+Z``; and the points.

    Examples
    --------
    >>> plate()[0].natural_frequencies.round(0)
    array([ 84.,  89., 193.])
    """
    from scipy.linalg import eigh

    from ema.elements import Plate, plate_matrices

    elements = (6, 4)
    matrices = plate_matrices(Plate(0.6, 0.4, 0.006, elements=elements), clamped=False)
    across = [row for row, dof in enumerate(matrices.dofs) if dof.direction not in ("+X", "+Y")]
    part = np.ix_(across, across)
    squares, vectors = eigh(matrices.stiffness[part], matrices.mass[part], subset_by_index=(3, 5))
    poles = poles_from(np.sqrt(squares) / (2 * np.pi), np.full(3, 0.005))
    shapes = vectors[::3]
    shapes = shapes * np.sign(shapes[0])
    nodes = np.arange(1, len(shapes) + 1)
    dofs = tuple(Dof(int(node), "+Z") for node in nodes)
    model = ModalModel(
        poles=poles,
        shapes=shapes.astype(complex),
        dofs=dofs,
        participation=shapes[:1] / (2j * poles.imag),
        inputs=dofs[:1],
        scaling="unit modal mass",
        name="plate",
    )
    grid = np.meshgrid(np.linspace(0, 0.6, elements[0] + 1), np.linspace(0, 0.4, elements[1] + 1), indexing="ij")
    xyz = np.column_stack([*(axis.ravel() for axis in grid), np.zeros(len(nodes))])
    return model, Geometry(nodes=nodes, xyz=xyz, name="plate")


def modal_map() -> ModalMap:
    """Return frequency and damping of a mode at two force levels and three normal forces.

    Returns
    -------
    ModalMap
        F_E of 5 and 20 N, F_N of 200, 500 and 1000 N; the damping is largest at 500 N.

    Examples
    --------
    >>> modal_map()
    ModalMap('mode 1', 2 levels 5 to 20 N, 3 normal forces 200 to 1000 N,
             frequency 40.2 to 41.2 Hz, damping 0.9 to 2.4 %, measured)
    """
    return ModalMap(
        force_levels=np.array([5.0, 20.0]),
        normal_forces=np.array([200.0, 500.0, 1000.0]),
        frequency=np.array([[40.6, 41.0, 41.2], [40.2, 40.7, 41.0]]),
        damping=np.array([[0.012, 0.016, 0.009], [0.018, 0.024, 0.013]]),
        frequency_std=np.full((2, 3), 0.02),
        damping_std=np.full((2, 3), 0.0005),
        name="mode 1",
    )


def beam_model() -> BeamModel:
    """Return two masses on springs, pressed together by one joint with Coulomb friction and tangential stiffness.

    Returns
    -------
    BeamModel
        Host of 2 kg and a beam of 0.5 kg, each on a spring to the ground in X; the joint of 100 N normal force, mu 0.5
        and 1e6 N/m.

    Examples
    --------
    >>> beam_model().joints[0].law
    FrictionLaw(name='masing', friction_coefficient=0.5, contact_stiffness=1e+06)
    """
    law = FrictionLaw(name="masing", friction_coefficient=0.5, contact_stiffness=1e6)
    joint = Joint(
        name="joint",
        pairs=((1, 1),),
        half_heights=(0.0, 0.0),
        law=law,
        normal_force=100.0,
        normal_stiffness=1e7,
    )
    directions = ("+X", "+Z", "+RY")
    return BeamModel(
        host=Matrices(
            np.diag([2.0, 2.0, 1e-3]), np.diag([2e5, 5e5, 1e3]), tuple(Dof(1, direction) for direction in directions)
        ),
        beam=Matrices(
            np.diag([0.5, 0.5, 1e-4]),
            np.diag([1e4, 1e4, 1e2]),
            tuple(Dof(1, direction, "beam") for direction in directions),
        ),
        joints=(joint,),
        name="two masses",
    )


def decay() -> Decay:
    """Return the ring-down of a mode of 40 Hz whose damping grows with the amplitude.

    Returns
    -------
    Decay
        50 points over 2 s, damping ratio from 2 % down to 1 %.

    Examples
    --------
    >>> decay().damping_ratios[[0, -1]]
    array([0.02, 0.01])
    """
    times = np.linspace(0.0, 2.0, 50)
    damping = np.linspace(0.02, 0.01, 50)
    rate = 2 * np.pi * 40.0 * damping
    # d(ln a)/dt = -zeta w, integrated by the trapezoidal rule
    logarithm = -np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(times))])
    return Decay(
        times=times,
        amplitudes=1e-3 * np.exp(logarithm),
        frequencies=np.linspace(39.8, 40.0, 50),
        damping_ratios=damping,
        name="mode 1",
    )


def campaign() -> Campaign:
    """Return a campaign of two hammer runs, without a beam and with one pressed by 500 N.

    Returns
    -------
    Campaign
        The runs ``bare`` and ``beam``, each with the record of :func:`recording`.

    Examples
    --------
    >>> campaign()
    Campaign('line', 2 runs: bare, beam, 4 nodes, 2 channels)
    """
    record = recording()
    hammer = Excitation(kind="hammer", level=100.0)
    pressed = Condition(hammer, joints=(JointForce("joint", mean=500.0, std=5.0),))
    runs = (Run("bare", Condition(hammer), recordings=(record,)), Run("beam", pressed, recordings=(record,)))
    return Campaign(name="line", runs=runs, geometry=geometry(), channels=record.channels)


def study_result() -> StudyResult:
    """Return a study of one run whose modes have not been picked yet, with a pole of each mode at two orders.

    Returns
    -------
    StudyResult
        The run ``bare`` with the FRFs of :func:`frf_set`, with noise of 0.1 %, and no mode.

    Examples
    --------
    >>> study_result().runs[0].poles
    PoleTable(6 poles, orders 6 to 8, band 20 to 120 Hz, 2 references)
    """
    model, frfs_ = modal_model(), frf_set(0.001)
    participation = np.tile((model.participation / np.linalg.norm(model.participation, axis=0)).T, (2, 1))
    poles = PoleTable(
        order=np.repeat([6, 8], 3),
        poles=np.tile(model.poles, 2),
        letter=np.array(["o"] * 3 + ["s"] * 3),
        participation=participation,
        references=model.inputs,
        band=(20.0, 120.0),
    )
    none = replace(model, poles=model.poles[:0], shapes=model.shapes[:, :0], participation=model.participation[:, :0])
    measured = campaign()
    return StudyResult(measured, (RunResult(measured["bare"], frfs_, poles, none),), title="line")


def forecast() -> Forecast:
    """Return a forecast of one mode on the grid of :func:`modal_map`.

    Returns
    -------
    Forecast
        Bands of 1 % of the frequency and 20 % of the damping on each side of the values of the map.

    Examples
    --------
    >>> forecast().damping.shape
    (1, 2, 3)
    """
    measured = modal_map()
    frequency, damping = measured.frequency[None], measured.damping[None]
    return Forecast(
        centre=(0.15, 0.0),
        angle=0.0,
        beam="beam",
        modes=(1,),
        bare_frequencies=np.array([40.0]),
        bare_damping=np.array([0.01]),
        force_levels=measured.force_levels,
        normal_forces=measured.normal_forces,
        frequency=frequency,
        frequency_low=0.99 * frequency,
        frequency_high=1.01 * frequency,
        damping=damping,
        damping_low=0.8 * damping,
        damping_high=1.2 * damping,
        draws=100,
        sources=("tangential contact stiffness", "friction coefficient"),
        frequency_shares=np.array([[0.8, 0.2]]),
        damping_shares=np.array([[0.3, 0.7]]),
    )


def trials() -> Trials:
    """Return two tests that would narrow :func:`forecast`: the beam bolted on, and loops of one joint.

    Returns
    -------
    Trials
        Forty draws; the bands of the damping have a half width of 20 %.

    Examples
    --------
    >>> trials().values.shape
    (40, 1, 2, 2, 3)
    """
    prediction = forecast()
    middle = np.stack([prediction.frequency, prediction.damping], axis=1)
    common, own = np.random.default_rng(1).standard_normal((2, 40))
    logs = np.stack([0.005 * own, 0.1 * common], axis=1)
    values = middle * np.exp(logs)[:, None, :, None, None]
    beam = Trial(
        "beam",
        ("mode 1: f [Hz]", "mode 1: zeta [-]"),
        values[:, 0, :, 0, 0],
        np.array([5e-4, 0.03]),
        1.5,
        float(prediction.force_levels[0]),
        float(prediction.normal_forces[0]),
        prediction.centre,
        prediction.angle,
        0.002,
        0.14,
    )
    loop = Trial(
        "loop",
        ("energy [J] at 1 mu F_N/k_T",),
        1e-3 * np.exp(0.1 * common)[:, None],
        np.array([0.05]),
        2.0,
        normal_force=float(prediction.normal_forces[0]),
        frequency_width=0.01,
        damping_width=0.08,
    )
    return Trials(prediction, values, (beam, loop))


def ranking() -> Ranking:
    """Return a ranking of two locations of a beam of 0.2 m for one mode.

    Returns
    -------
    Ranking
        Two candidates over the grid of :func:`modal_map`; the first gives the damping of the map, the
        second half of it.

    Examples
    --------
    >>> ranking().scores
    array([0.016, 0.008])
    """
    measured = modal_map()
    beam = FrictionBeam(spacing=0.2, width=0.02, height=0.01, name="beam")
    candidates = Candidates(np.array([[0.15, 0.0], [0.10, 0.0]]), np.zeros(2), np.zeros(2, dtype=np.int64), (beam,))
    damping = np.array([measured.damping, 0.5 * measured.damping])[:, None]
    frequency = np.array([measured.frequency, measured.frequency])[:, None]
    prediction = Prediction(
        candidates=candidates,
        modes=(0,),
        bare_frequencies=np.array([40.0]),
        bare_damping=np.array([0.005]),
        force_levels=measured.force_levels,
        normal_forces=measured.normal_forces,
        frequency=frequency,
        damping=damping,
        stiffness=(2 * np.pi * frequency) ** 2,
        slip=np.full(damping.shape, 2.0),
        driver=np.array([0.5]),
        output=np.array([0.5]),
    )
    scores = damping[:, 0, :, 1].min(axis=1)
    places = tuple(
        Place(
            candidate=row,
            centre=(float(candidates.centres[row, 0]), float(candidates.centres[row, 1])),
            angle=0.0,
            beam=beam.name,
            score=float(scores[row]),
            score_low=0.8 * float(scores[row]),
            score_high=1.2 * float(scores[row]),
            normal_force=500.0,
            normal_forces=np.full(2, 500.0),
            frequency=frequency[row, :, :, 1],
            damping=damping[row, :, :, 1],
            damping_low=0.8 * damping[row, :, :, 1],
            damping_high=1.2 * damping[row, :, :, 1],
            mass_shift=np.array([-0.4]),
            stiffness_shift=np.array([1.6]),
        )
        for row in range(2)
    )
    return Ranking("smallest damping over the force levels", prediction, scores, places)


def placement() -> Placement:
    """Return the placement that belongs to :func:`ranking`, with the forecast of its best location.

    Returns
    -------
    Placement
        On a plane of 0.3 m x 0.1 m.

    Examples
    --------
    >>> placement().ranking.best.centre
    (0.15, 0.0)
    """
    extent = np.array([[0.0, 0.3], [-0.05, 0.05]])
    return Placement(
        title="line",
        ranking=ranking(),
        origin=np.zeros(3),
        axes=np.eye(3),
        extent=extent,
        points=np.column_stack([0.1 * np.arange(4), np.zeros(4)]),
        geometry=geometry(),
        forecast=forecast(),
    )
