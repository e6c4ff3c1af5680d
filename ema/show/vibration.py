"""Free vibration with friction: motion, energy and hysteresis of the contacts; one motion against another."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from ema.data import Response
from ema.dof import Dof, match
from ema.errors import InputError
from ema.show.style import SERIES, new_figure, styled


def _row(run: Response, dof: Dof | str | None) -> int:
    if dof is None:
        return 0
    matches = match([Dof.parse(dof)], run.dofs)
    if not matches:
        raise InputError(
            "no such DOF in the response", where=run.name, got=str(dof), expected=", ".join(str(d) for d in run.dofs)
        )
    return matches[0][1]


@styled
def free_vibration(
    runs: Sequence[Response], labels: Sequence[str], dof: Dof | str | None = None, contacts: Sequence[int] | None = None
) -> Figure:
    """Draw displacement and energy over time, and below for each run the loops of some contacts.

    Parameters
    ----------
    runs : sequence of Response
        Motions.
    labels : sequence of str
        One for each run.
    dof : Dof or str, optional
        DOF whose displacement is drawn; the first one of each run by default.
    contacts : sequence of int, optional
        Numbers of the contacts whose loops are drawn; first, middle and last by default.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If there is no run, a run lacks the DOF, or a contact number does not exist.

    Examples
    --------
    >>> from ema.data import EnergyBalance, Response
    >>> from ema.dof import Dof
    >>> zero = np.zeros(2)
    >>> run = Response(
    ...     times=[0.0, 0.1], displacements=[zero], velocities=[zero], dofs=(Dof(1, "+X"),), slips=[[1e-6, -1e-6]],
    ...     forces=[[5.0, -5.0]], dissipated=[1e-5], slip_time=[0.5],
    ...     energy=EnergyBalance([1.0, 0.9], zero, zero, zero, zero, zero),
    ... )
    >>> len(free_vibration([run], ["100 N"]).axes) > 2
    True
    """
    if not runs or len(labels) != len(runs):
        raise InputError(
            "nothing to draw",
            got=f"{len(runs)} runs, {len(labels)} labels",
            expected="one run or more, and one label for each",
        )
    least = min(len(run.forces) for run in runs)
    numbers = list(dict.fromkeys([0, least // 2, least - 1])) if contacts is None else list(contacts)
    if not numbers or any(not 0 <= number < least for number in numbers):
        raise InputError(
            "no such contact",
            got=numbers,
            expected=f"numbers from 0 to {least - 1}" if least else "runs with contacts",
        )
    figure = new_figure(2.9 + 2.3 * len(runs))
    top, *rows = np.ravel(figure.subfigures(1 + len(runs), 1, height_ratios=[2.9, *[2.3] * len(runs)], squeeze=False))
    motion, energy = top.subplots(1, 2, width_ratios=[3, 2])
    for run, label, (colour, style, _) in zip(runs, labels, SERIES, strict=False):
        motion.plot(run.times, 1e3 * run.displacements[_row(run, dof)], color=colour, label=label, lw=1.0)
        energy.plot(run.times, 1e3 * run.energy.total, color=colour, ls=style, label=label)
    name = str(runs[0].dofs[_row(runs[0], dof)])
    motion.set(xlabel="Time [s]", ylabel=f"Displacement {name} [mm]", title="free vibration")
    energy.set(xlabel="Time [s]", ylabel="Energy [mJ]", title="mechanical and contact energy")
    motion.legend(loc="upper right")
    energy.set_ylim(bottom=0)
    for place, (run, label) in enumerate(zip(runs, labels, strict=True)):
        colour = SERIES[place % len(SERIES)][0]
        for axes, number in zip(rows[place].subplots(1, len(numbers), squeeze=False)[0], numbers, strict=True):
            axes.plot(1e6 * run.slips[number], run.forces[number], color=colour, lw=0.9)
            axes.set(xlabel="Relative displacement [µm]", title=f"{label}, contact {number + 1} of {len(run.forces)}")
        rows[place].axes[0].set_ylabel("Friction force [N]")
    return figure


@styled
def velocity_comparison(
    measured: Response,
    computed: Response,
    band: tuple[float, float],
    labels: tuple[str, str] = ("measured", "computed"),
    dof: Dof | str | None = None,
    zoom: float | None = None,
) -> Figure:
    """Draw two velocities over time, at the start and as a whole, and their spectra.

    Samples of a simulation have passed no anti-alias filter: their spectrum needs a high sampling rate.

    Parameters
    ----------
    measured, computed : Response
        Motions to compare.
    band : tuple of (float, float)
        Ends of the band of the spectra [Hz].
    labels : tuple of (str, str), default ('measured', 'computed')
        Names of the two.
    dof : Dof or str, optional
        DOF whose velocity is drawn; the first one by default.
    zoom : float, optional
        How much of the start is drawn large [s]; a tenth of the record by default.

    Returns
    -------
    Figure
        The figure.

    Raises
    ------
    InputError
        If a run lacks the DOF.

    Examples
    --------
    >>> from ema.data import EnergyBalance, Response
    >>> from ema.dof import Dof
    >>> times = np.linspace(0.0, 1.0, 256)
    >>> zero = np.zeros(256)
    >>> run = Response(
    ...     times=times, displacements=[np.cos(200 * times)], velocities=[-200 * np.sin(200 * times)],
    ...     dofs=(Dof(1, "+X"),), slips=np.zeros((0, 256)), forces=np.zeros((0, 256)), dissipated=[], slip_time=[],
    ...     energy=EnergyBalance(zero, zero, zero, zero, zero, zero),
    ... )
    >>> len(velocity_comparison(run, run, band=(10.0, 100.0)).axes)
    3
    """
    figure = new_figure(5.2)
    upper, lower = np.ravel(figure.subfigures(2, 1, squeeze=False))
    whole = upper.subplots()
    start, spectrum = lower.subplots(1, 2)
    for run, label, (colour, style, _) in zip((measured, computed), labels, SERIES, strict=False):
        velocity = run.velocities[_row(run, dof)]
        whole.plot(run.times, velocity, color=colour, lw=0.8, label=label, alpha=0.85)
        early = run.times <= (zoom or 0.1 * run.times[-1])
        start.plot(run.times[early], velocity[early], color=colour, ls=style, label=label)
        frequencies, level = amplitude_spectrum(run.times, velocity)
        inside = (frequencies >= band[0]) & (frequencies <= band[1])
        spectrum.semilogy(frequencies[inside], level[inside], color=colour, ls=style, label=label)
    whole.set(xlabel="Time [s]", ylabel="Velocity [m/s]", title="free vibration")
    start.set(xlabel="Time [s]", ylabel="Velocity [m/s]", title="start")
    spectrum.set(xlabel="Frequency [Hz]", ylabel="Velocity [m/s]", title="spectrum (Hann)")
    spectrum.legend(loc="upper right")
    return figure


def amplitude_spectrum(
    times: Float[np.ndarray, "sample"], values: Float[np.ndarray, "sample"]
) -> tuple[Float[np.ndarray, "line"], Float[np.ndarray, "line"]]:
    """Frequencies in Hz and amplitudes of a record under a Hann window."""
    window = np.hanning(len(values))
    spectrum = np.abs(np.fft.rfft(values * window)) * 2 / window.sum()
    return np.fft.rfftfreq(len(values), float(times[1] - times[0])), spectrum
