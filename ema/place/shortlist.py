"""The shortlist with all modes together: harmonic balance of the full model at every place."""

import hashlib
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from ema import fingerprint, store
from ema.data import BeamModel, Finding, ModalMap
from ema.data.placement import Prediction
from ema.dof import Dof
from ema.errors import EmaError, FailureError, InputError
from ema.place.lift_off import PRESSURE
from ema.place.model import model_at
from ema.place.objective import of_rows
from ema.place.task import Task
from ema.progress import Progress, advance, note, silent

TOLERANCE = 1e-2
"""Relative error of the simulation that is aimed at."""
WIDER = 0.05
"""Part of a frequency by which bands are wider than the predicted frequencies of a mode."""
_EDGE = 1e-3
"""A response that is largest this near the end of its band, relative, is the flank of another mode's peak."""
_REACH = (0.01, 0.025)
"""How far from the resonance of the fundamental alone, relative, that with all harmonics lies, mostly and at most.

The two differ by up to 0.1 % where the modes are well apart, and by half a half-power bandwidth where a peak is flat.
Half as much sends flat peaks to a second search; twice as much takes some peaks of neighbours.
"""
_IN_FLIGHT = 32
"""Questions that workers have at a time."""


class Question(NamedTuple):
    """What a worker is asked: resonances of one model in one band per mode, over force levels and normal forces.

    ``targets`` are the rows of these modes among those of the bare structure: the peak is sought that belongs to each.
    With ``fitted`` it is what a one-mode fit of a stepped sine about the largest response of ``output`` (the excited
    DOF where ``None``) reads. With the exponent of a ``pressure`` its patches lift off at their edges.
    """

    model: BeamModel
    at: Dof
    force_levels: Float[np.ndarray, "level"]
    normal_forces: Float[np.ndarray, "force"]
    bands: tuple[tuple[float, float], ...]
    fitted: bool = False
    output: Dof | None = None
    targets: tuple[int, ...] = ()
    pressure: float | None = None


def answer(question: Question) -> Float[np.ndarray, "mode 4 level force"]:
    """Frequency Hz, damping ratio, height |X| in m at the excited DOF and opening of every resonance, at all harmonics.

    NaN where none was found. The height follows from the balance of power, F |X| pi = 2 pi zeta w^2 a^2 of the modal
    amplitude a. The opening is that of ``fundamental``, and what patches change that lift off at their edges is what
    the fundamental alone says of it.
    """
    from ema.place.fundamental import fundamental

    levels, forces = np.asarray(question.force_levels), np.asarray(question.normal_forces)
    result = np.full((len(question.bands), 4, len(levels), len(forces)), np.nan)
    pulling = fundamental(question._replace(fitted=False, pressure=None))
    rough = pulling[:, 0]
    for row, band in enumerate(question.bands):
        if np.isfinite(rough[row]).any():
            result[row, :3] = _largest(question, band)
    # a neighbour's peak is often higher than that of the mode, or a band ends before it
    result = np.where(np.isfinite(rough)[:, None], result, np.nan)
    strange = np.isfinite(rough) & ~(np.abs(result[:, 0] / rough - 1) <= _REACH[0])
    for row, number, column in np.argwhere(strange):
        model = question.model.with_normal_force(float(forces[column]))
        peak = _near(question, model, float(levels[number]), float(rough[row, number, column]))
        result[row, :3, number, column] = peak
    result[:, 3] = pulling[:, 2]
    if question.pressure is not None:
        whole = fundamental(question._replace(pressure=None)) if question.fitted else pulling
        change = fundamental(question)[:, :2] / whole[:, :2]
        result[:, :2] *= change
        # |X| goes with 1/(zeta w^2)
        result[:, 2] /= change[:, 1] * change[:, 0] ** 2
    return result


def _largest(question: Question, band: tuple[float, float]) -> Float[np.ndarray, "3 level force"]:
    """Frequency, damping and height of the largest responses in a band; NaN at its ends, and where there is none."""
    from ema.compare import measure
    from ema.simulate import damping_map

    levels, forces = np.asarray(question.force_levels), np.asarray(question.normal_forces)
    some = np.full((len(levels), len(forces)), np.sqrt(band[0] * band[1]))
    try:
        if question.fitted:
            wanted = ModalMap(levels, forces, some, np.full_like(some, 0.01), method="measured")
            output = question.output or question.at
            chart = measure(question.model, wanted, question.at, output, band, TOLERANCE)
        else:
            chart = damping_map(question.model, levels, forces, question.at, question.at, band, TOLERANCE)
    except InputError:
        return np.full((3, *some.shape), np.nan)
    assert chart.modal_amplitude is not None
    inside = np.abs(np.log(chart.frequency / np.sqrt(band[0] * band[1]))) < 0.5 * np.log(band[1] / band[0]) - _EDGE
    lost = 2 * chart.damping * (2 * np.pi * chart.frequency * chart.modal_amplitude) ** 2
    return np.where(inside, [chart.frequency, chart.damping, lost / levels[:, None]], np.nan)


def _near(question: Question, model: BeamModel, level: float, frequency: float) -> tuple[float, float, float]:
    """Frequency, damping and height of the resonance next to that of the fundamental alone."""
    for reach in _REACH:
        band = frequency * (1 - reach), frequency * (1 + reach)
        force = np.array([model.joints[0].normal_force])
        single = question._replace(model=model, force_levels=np.array([level]), normal_forces=force)
        peak = _largest(single, band)[:, 0, 0]
        if np.isfinite(peak[0]):
            return float(peak[0]), float(peak[1]), float(peak[2])
    return np.nan, np.nan, np.nan


def verify(
    task: Task,
    prediction: Prediction,
    rows: Sequence[int] | np.ndarray,
    executor: Executor | None = None,
    kept: "KeptPlaces | None" = None,
    progress: Progress = silent,
) -> Prediction:
    """Compute some locations of a prediction again, with all modes together.

    Parameters
    ----------
    task : Task
        Structure, joint, forces and target modes.
    prediction : Prediction
        Prediction by the one-mode predictor.
    rows : sequence of int or array
        Candidates to compute, rows from 0.
    executor : Executor, optional
        Where they are computed; in this process by default. Anything with ``submit`` of ``concurrent.futures`` will do.
    kept : KeptPlaces, optional
        Where every finished location is kept and, when resuming, taken from. A ``progress`` with a method ``note`` is
        given how many, and why not all.
    progress : Progress, optional
        Called after each location.

    Returns
    -------
    Prediction
        Prediction with the ``method`` "all modes", in the order of ``rows``.

    Raises
    ------
    FailureError
        If a worker died, or the folder cannot be used; what is finished is kept.

    Examples
    --------
    >>> from ema.data import BoltedJoint, FrictionBeam, FrictionLaw
    >>> from ema.examples import plate
    >>> from ema.place import Task, grid, predict
    >>> from ema.shapes import smooth
    >>> bare, geometry = plate()
    >>> surface = smooth(bare, geometry)
    >>> joint = BoltedJoint(FrictionLaw("masing", 0.4, 2e7), 1e8, surface_height=0.003)
    >>> task = Task(bare, surface, joint, "1:+Z", np.array([10.0]), np.array([50.0]), modes=(0,))
    >>> spots = grid(surface, [FrictionBeam(0.2, 0.02, 0.01)], step=0.2)
    >>> verify(task, predict(task, spots), [0]).method
    'all modes'
    """
    picked = np.asarray(rows, dtype=np.int64)
    questions = [question(task, prediction, int(row)) for row in picked]
    answers: dict[int, np.ndarray] = {}
    if kept is not None and kept.resume:
        for number, one in enumerate(questions):
            known = kept.known(fingerprint_of(one))
            if known is not None:
                answers[number] = known
        kept.report(progress)
    wanted = [number for number in range(len(questions)) if number not in answers]
    for number, found in verify_all(questions, executor, wanted, None if kept is None else kept.folder):
        answers[number] = found
        if kept is not None:
            kept.keep(fingerprint_of(questions[number]), found)
        advance(progress, "all modes together", len(answers), len(questions))
    return _joined(of_rows(prediction, picked), picked, answers, task.joint.normal_contact == "unilateral")


def _joined(few: Prediction, rows: np.ndarray, answers: dict[int, np.ndarray], unilateral: bool) -> Prediction:
    """The answers as a prediction; none where joints part that are ``unilateral``."""
    if not len(rows):
        return replace(few, method="all modes")
    values = np.stack([answers[number] for number in range(len(rows))])
    parted = (values[:, :, 3] >= 1) & unilateral
    lost = np.isnan(values[:, :, :3]).any(axis=2) & ~parted
    values = np.where(parted[:, :, None], np.nan, values)
    drive = few.driver[:, None, None] ** 2 * few.force_levels[:, None]
    return replace(
        few,
        frequency=values[:, :, 0],
        damping=values[:, :, 1],
        stiffness=drive / values[:, :, 2],
        slip=np.full(few.slip.shape, np.nan),
        method="all modes",
        findings=_about_places(lost, parted),
    )


def _about_places(
    lost: Bool[np.ndarray, "place mode level force"], parted: Bool[np.ndarray, "place mode level force"]
) -> tuple[Finding, ...]:
    """How many places have conditions without a steady state, or in which a joint parts that cannot pull."""
    findings = []
    for code, without, what, advice in (
        (
            "unsolved",
            lost,
            f"have no steady state for a mode within {WIDER:.0%} of its predicted frequencies",
            "They count as unsuitable.",
        ),
        (
            "joint-parts",
            parted,
            "have conditions in which the normal force of a joint varies by more than F_N: it parts and rattles",
            "Such conditions count as unsuitable; press more, or excite less.",
        ),
    ):
        count = int(without.any(axis=(1, 2, 3)).sum())
        if count:
            text = f"{count} of {len(without)} places {what}."
            findings.append(Finding("warning", code, "shortlist", text, float(count), 0.0, advice))
    return tuple(findings)


def question(task: Task, prediction: Prediction, row: int, fitted: bool = False) -> Question:
    """The model of one place, and for every mode the band of its predicted frequencies, a little wider."""
    bands = []
    for m, bare in enumerate(prediction.bare_frequencies):
        frequencies = prediction.frequency[row, m]
        known = frequencies[np.isfinite(frequencies)]
        low, high = (known.min(), known.max()) if len(known) else (0.9 * bare, 1.1 * bare)
        bands.append((float((1 - WIDER) * low), float((1 + WIDER) * high)))
    model = model_at(task, prediction.candidates, row, float(prediction.normal_forces[0]))
    return of_model(task, model, bands, fitted=fitted)


def of_model(task: Task, model: BeamModel, bands: Sequence[tuple[float, float]], *, fitted: bool) -> Question:
    """The model under the forces of the task, with a band in Hz for every target mode."""
    return Question(
        model,
        Dof.parse(task.at),
        np.asarray(task.force_levels, dtype=np.float64),
        np.asarray(task.normal_forces, dtype=np.float64),
        tuple(bands),
        fitted,
        None if task.output is None else Dof.parse(task.output),
        tuple(int(mode) for mode in task.modes),
        float(np.mean(PRESSURE)) if task.joint.normal_contact == "unilateral" else None,
    )


def verify_all(
    questions: Sequence[Question],
    executor: Executor | None = None,
    wanted: Sequence[int] | None = None,
    kept: Path | None = None,
) -> Iterator[tuple[int, Float[np.ndarray, "mode 4 level force"]]]:
    """Number and answer of every wanted question as they come, with few under way at a time.

    Raises
    ------
    FailureError : a worker died; ``kept`` is where finished answers are.
    """
    wanted = range(len(questions)) if wanted is None else wanted
    if executor is None:
        for number in wanted:
            yield number, answer(questions[number])
        return
    waiting, running = list(wanted), dict[Future[Any], int]()
    try:
        while waiting or running:
            while waiting and len(running) < _IN_FLIGHT:
                number = waiting.pop(0)
                running[executor.submit(answer, questions[number])] = number
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), np.asarray(future.result())
    except EmaError:
        raise
    except Exception as error:
        where = "what is finished is lost" if kept is None else f"what is finished is kept in {kept}"
        raise FailureError(
            "a worker failed",
            got=f"{type(error).__name__}: {str(error).splitlines()[0] if str(error) else ''}",
            advice=f"{where}; look after the workers and start again",
        ) from error
    finally:
        for future in running:
            future.cancel()


def fingerprint_of(question: Any) -> str:
    """What tells a question, or a part of one, from every other."""
    digest = hashlib.sha256(str(TOLERANCE).encode())
    _stir(digest, question)
    return digest.hexdigest()[:24]


def _stir(digest: Any, value: Any) -> None:
    """All that a value consists of, into the fingerprint."""
    if is_dataclass(value) and not isinstance(value, type):
        for member in fields(value):
            # findings and origins do not change an answer
            if member.compare:
                _stir(digest, getattr(value, member.name))
    elif isinstance(value, np.ndarray):
        digest.update(repr((value.shape, value.dtype.str)).encode() + np.ascontiguousarray(value).tobytes())
    elif isinstance(value, tuple | list):
        digest.update(f"{len(value)}:".encode())
        for item in value:
            _stir(digest, item)
    else:
        digest.update(repr(value).encode())


class KeptPlaces:
    """Finished locations in a folder, one file each, named by the fingerprints of the question and of the code.

    Parameters
    ----------
    folder : str or Path
        Where they are kept.
    resume : bool, default False
        Take what is there already instead of computing it again.

    Examples
    --------
    >>> KeptPlaces("checked", resume=True).folder.name
    'checked'
    """

    def __init__(self, folder: str | Path, resume: bool = False) -> None:
        self.folder, self.resume = Path(folder), resume
        self._code = hashlib.sha256(repr(fingerprint.versions()).encode()).hexdigest()[:12]
        self._taken = self._damaged = self._other = self._new = 0

    def name(self, question: str) -> str:
        """Return the name of the file of an answer.

        Parameters
        ----------
        question : str
            Fingerprint of the question.

        Returns
        -------
        str
            Name within the folder.

        Examples
        --------
        >>> KeptPlaces("checked").name("a1b2").startswith("a1b2-")
        True
        """
        return f"{question}-{self._code}.npy"

    def known(self, question: str) -> Float[np.ndarray, "mode 4 level force"] | None:
        """Return an answer computed before by this code; a damaged file counts as none.

        Parameters
        ----------
        question : str
            Fingerprint of the question.

        Returns
        -------
        array of shape (mode, 4, level, force) or None
            As of ``answer``.

        Examples
        --------
        >>> KeptPlaces("checked").known("a1b2") is None
        True
        """
        path = self.folder / self.name(question)
        if path.is_file():
            try:
                answer = np.asarray(np.load(path, allow_pickle=False))
            except (OSError, ValueError, EOFError):
                self._damaged += 1
                return None
            self._taken += 1
            return answer
        if self._former(question):
            self._other += 1
        else:
            self._new += 1
        return None

    def report(self, progress: Progress) -> None:
        """Say what was taken and what has to be computed, and why.

        Parameters
        ----------
        progress : Progress
            Given the sentence by its method ``note``.

        Examples
        --------
        >>> from ema.progress import silent
        >>> KeptPlaces("checked").report(silent)
        """
        counts = (
            (self._taken, "taken as computed"),
            (self._damaged, "computed again: the kept file cannot be read"),
            (self._other, "computed again: the code or the packages under it have changed"),
            (self._new, "not computed before"),
        )
        note(progress, "places: " + "; ".join(f"{count} {what}" for count, what in counts if count))

    def keep(self, question: str, answer: Float[np.ndarray, "mode 4 level force"]) -> None:
        """Put an answer on disk in place of those of other code.

        Parameters
        ----------
        question : str
            Fingerprint of the question.
        answer : array of shape (mode, 4, level, force)
            As of ``answer``.

        Raises
        ------
        FailureError
            If the folder cannot be written.

        Examples
        --------
        >>> from tempfile import mkdtemp
        >>> kept = KeptPlaces(mkdtemp())
        >>> kept.keep("a1b2", np.ones((1, 4, 1, 1)))
        >>> kept.known("a1b2").shape
        (1, 4, 1, 1)
        """
        path = self.folder / self.name(question)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with store.replacing(path) as target, open(target, "wb") as file:
                np.save(file, answer)
            for former in self._former(question):
                former.unlink(missing_ok=True)
        except OSError as error:
            raise FailureError(
                "the finished places cannot be kept",
                where=str(self.folder),
                got=error.strerror or str(error),
                advice="choose a folder that can be written and has space",
            ) from error

    def _former(self, question: str) -> list[Path]:
        """Files of the answer by other code."""
        answers = self.folder.glob(f"{question}*.npy")
        return [path for path in answers if path.name != self.name(question)]
