"""What a structure with friction did: motions with their energy, steady states, hysteresis loops, ring-downs."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ema.data import ControlLine, CuttingLimits, Decay, HarmonicResponse, Loop, Response
from ema.errors import InputError
from ema.messages import text
from ema.show.style import FAINT, GREY, SERIES, empty_note, new_figure, styled

_PREFIXES = ((1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))


def _scaled(values: Sequence[Float[np.ndarray, "_"]], unit: str) -> tuple[float, str]:
    """Factor and unit with which the largest of the values reads well."""
    largest = max((float(np.nanmax(np.abs(part), initial=0.0)) for part in values), default=0.0)
    for factor, prefix in _PREFIXES:
        if largest >= factor:
            return factor, prefix + unit
    return 1.0, unit


@styled
def motion(responses: Sequence[Response] | Response, labels: Sequence[str] = ()) -> Figure:
    """Draw the displacement of the first DOF over time, and the energies, for one response or several.

    Parameters
    ----------
    responses : sequence of Response or Response
        One motion, or several.
    labels : sequence of str, optional
        One for each; their names by default.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no motion.

    Examples
    --------
    >>> from ema.data import EnergyBalance, Response
    >>> from ema.dof import Dof
    >>> zero = np.zeros(2)
    >>> run = Response(
    ...     times=[0.0, 0.1], displacements=[[1e-3, 5e-4]], velocities=[zero], dofs=(Dof(1, "+X"),),
    ...     slips=np.zeros((0, 2)), forces=np.zeros((0, 2)), dissipated=[], slip_time=[],
    ...     energy=EnergyBalance([1.0, 0.9], zero, zero, zero, zero, zero),
    ... )
    >>> len(motion(run, ["released"]).axes)
    2
    """
    runs = [responses] if isinstance(responses, Response) else list(responses)
    figure = new_figure(4.6)
    if not runs or not len(runs[0].dofs):
        empty_note(figure.subplots(), text("no motion"))
        return figure
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    factor, unit = _scaled([np.asarray(run.displacements[0]) for run in runs], "m")
    for number, run in enumerate(runs):
        colour, style, _ = SERIES[number % len(SERIES)]
        name = labels[number] if number < len(labels) else run.name
        upper.plot(
            run.times, run.displacements[0] / factor, color=colour, lw=1.0, label=name, rasterized=len(run.times) > 5000
        )
        start = float(run.energy.total[0]) or float(np.max(run.energy.total)) or 1.0
        lower.plot(run.times, 100 * run.energy.total / start, color=colour, ls=style, label=name)
    upper.set_ylabel(text("Displacement of {dof} [{unit}]", dof=runs[0].dofs[0], unit=unit))
    lower.set_ylabel(text("Energy left [%]"))
    lower.set_ylim(bottom=0)
    lower.set_xlabel(text("Time [s]"))
    if len(runs) > 1 or labels:
        upper.legend(loc="upper right", ncols=4)
    return figure


@styled
def contact_loops(response: Response, most: int = 4) -> Figure:
    """Draw friction force over relative displacement at some contacts, and the energy that every contact dissipated.

    Parameters
    ----------
    response : Response
        A motion with contacts.
    most : int, default 4
        Largest number of contacts whose loops are drawn.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no contact.

    Raises
    ------
    InputError
        If no contact is to be drawn.

    Examples
    --------
    >>> from ema.data import EnergyBalance, Response
    >>> from ema.dof import Dof
    >>> zero = np.zeros(2)
    >>> motion = Response(
    ...     times=[0.0, 0.1], displacements=[zero], velocities=[zero], dofs=(Dof(1, "+X"),), slips=[[1e-6, -1e-6]],
    ...     forces=[[5.0, -5.0]], dissipated=[1e-5], slip_time=[0.5],
    ...     energy=EnergyBalance([1.0, 1.0], zero, zero, zero, zero, zero),
    ... )
    >>> len(contact_loops(motion).axes)
    2
    """
    figure = new_figure(3.4)
    count = len(response.slips)
    if not count:
        empty_note(figure.subplots(), text("no contact"))
        return figure
    loops, shares = figure.subplots(1, 2, width_ratios=[3, 2])
    if most < 1:
        raise InputError("no contact to draw", where=response.name, got=most, expected="1 or more")
    chosen = np.unique(np.linspace(0, count - 1, min(most, count)).round().astype(int))
    factor, unit = _scaled([np.asarray(response.slips[k]) for k in chosen], "m")
    for number, place in enumerate(chosen):
        colour = SERIES[number % len(SERIES)][0]
        loops.plot(
            response.slips[place] / factor,
            response.forces[place],
            color=colour,
            lw=0.7,
            label=f"{place + 1}",
            rasterized=response.slips.shape[1] > 5000,
        )
        shares.bar(place + 1, response.dissipated[place], color=colour, width=0.8, zorder=3)
    others = [place for place in range(count) if place not in chosen]
    shares.bar(np.array(others) + 1, response.dissipated[others], color=FAINT, width=0.8)
    loops.set_xlabel(text("Relative displacement [{unit}]", unit=unit))
    loops.set_ylabel(text("Friction force [N]"))
    figure.legend(title=text("contact"), loc="outside right upper")
    shares.set_xlabel(text("Contact"))
    shares.set_ylabel(text("Energy dissipated [J]"))
    return figure


@styled
def steady_states(responses: Sequence[HarmonicResponse] | HarmonicResponse, labels: Sequence[str] = ()) -> Figure:
    """Draw the first harmonic of the first DOF per newton, and the strongest higher harmonic relative to it.

    Parameters
    ----------
    responses : sequence of HarmonicResponse or HarmonicResponse
        One set of steady states, or several.
    labels : sequence of str, optional
        One for each; their force by default.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no steady state.

    Raises
    ------
    InputError
        If a set of steady states lacks their fundamental, order 1.

    Examples
    --------
    >>> from ema.data import HarmonicResponse
    >>> from ema.dof import Dof
    >>> response = HarmonicResponse(
    ...     frequencies=[39.0, 40.0], orders=[1, 3], values=[[[1e-4, 1e-6]], [[1e-3, 2e-6]]], dofs=(Dof(1, "+X"),),
    ...     slips=np.zeros((2, 0, 2)), force=1.0, driven=Dof(1, "+X"), input_power=[0.01, 0.12],
    ...     friction_power=[0.0, 0.07], damping_power=[0.01, 0.05], error_estimate=[1e-6, 1e-6], converged=[True, True],
    ... )
    >>> len(steady_states(response).axes)
    2
    """
    runs = [responses] if isinstance(responses, HarmonicResponse) else list(responses)
    figure = new_figure(4.8)
    if not runs or not len(runs[0].frequencies) or not len(runs[0].dofs):
        empty_note(figure.subplots(), text("no steady state"))
        return figure
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 1.3])
    gains = [np.abs(_order(run, 1)) / run.force for run in runs]
    factor, unit = _scaled(gains, "m")
    for number, (run, gain) in enumerate(zip(runs, gains, strict=True)):
        colour, style, _ = SERIES[number % len(SERIES)]
        name = labels[number] if number < len(labels) else f"{run.force:g} N"
        upper.plot(run.frequencies, gain / factor, color=colour, ls=style, label=name)
        rest = [np.abs(_order(run, int(k))) for k in run.orders if k > 1]
        share = np.max(rest, axis=0) / (gain * run.force) if rest else 0 * gain
        lower.plot(run.frequencies, 100 * share, color=colour, ls=style)
    upper.set_yscale("log")
    upper.set_ylabel(f"|X({runs[0].dofs[0]})| / F [{unit}/N]")
    upper.legend(title=text("force level"), loc="upper right")
    lower.set_ylabel(text("Harmonics [%]"))
    lower.set_ylim(bottom=0)
    lower.set_xlabel(text("Frequency [Hz]"))
    lower.margins(x=0)
    return figure


def _order(run: HarmonicResponse, order: int) -> np.ndarray:
    """Amplitudes of one harmonic of the first DOF."""
    if order not in run.orders:
        raise InputError(
            "the response lacks a harmonic that is drawn",
            where=run.name,
            got=", ".join(map(str, run.orders)) or "no order",
            expected=f"order {order} among them",
        )
    return np.asarray(run.values[:, 0, list(run.orders).index(order)])


@styled
def hysteresis(loops: Sequence[Loop] | Loop, labels: Sequence[str] = ()) -> Figure:
    """Draw force over relative displacement of one loop or several, with the energy per cycle of each.

    Parameters
    ----------
    loops : sequence of Loop or Loop
        One loop, or several.
    labels : sequence of str, optional
        One for each loop; their names by default.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no loop.

    Examples
    --------
    >>> from ema.data import Loop
    >>> angle = np.linspace(0, 2 * np.pi, 50)
    >>> loop = Loop(1e-6 * np.cos(angle), 5 * np.cos(angle - 0.3), area=4.6e-6, amplitude=1e-6)
    >>> len(hysteresis(loop, ["joint"]).axes)
    1
    """
    drawn = [loops] if isinstance(loops, Loop) else list(loops)
    figure = new_figure(3.8, 6.5)
    axes = figure.subplots()
    if not drawn:
        empty_note(axes, text("no loop"))
        return figure
    factor, unit = _scaled([np.asarray(loop.displacements) for loop in drawn], "m")
    for number, loop in enumerate(drawn):
        colour, style, _ = SERIES[number % len(SERIES)]
        name = labels[number] if number < len(labels) else loop.name
        area = _energy(loop.area)
        label = f"{name}: {area}".lstrip(": ")
        axes.plot(loop.displacements / factor, loop.forces, color=colour, ls=style, lw=1.1, label=label)
    axes.set_xlabel(text("Relative displacement [{unit}]", unit=unit))
    axes.set_ylabel(text("Force [N]"))
    axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), title=text("energy per cycle"))
    return figure


def _energy(joule: float) -> str:
    factor, unit = _scaled([np.array([joule])], "J")
    return f"{joule / factor:.3g} {unit}" if joule > 1e-12 else text("none")


@styled
def ring_down(decays: Sequence[Decay] | Decay, labels: Sequence[str] = (), unit: str = "") -> Figure:
    """Draw frequency and damping over the amplitude of ring-downs, and the amplitude over time.

    Parameters
    ----------
    decays : sequence of Decay or Decay
        One ring-down, or several.
    labels : sequence of str, optional
        One for each; their names by default.
    unit : str, optional
        Unit of the amplitudes.

    Returns
    -------
    Figure
        The figure, with a note in it where there is no ring-down.

    Examples
    --------
    >>> from ema.examples import decay
    >>> len(ring_down(decay(), unit="m").axes)
    3
    """
    drawn = [decays] if isinstance(decays, Decay) else list(decays)
    figure = new_figure(5.2)
    if not drawn:
        empty_note(figure.subplots(), text("no ring-down"))
        return figure
    first, second, third = figure.subplots(3, 1)
    for number, decay in enumerate(drawn):
        colour, style, _ = SERIES[number % len(SERIES)]
        name = labels[number] if number < len(labels) else decay.name
        first.semilogy(decay.times, decay.amplitudes, color=colour, ls=style, label=name)
        if np.isfinite(decay.knee):
            first.axvline(decay.knee, color=colour, lw=0.8, ls=(0, (2, 2)))
        inside = np.where(_readable(decay), 1.0, np.nan)
        second.semilogx(decay.amplitudes, inside * decay.frequencies, color=colour, ls=style)
        third.loglog(decay.amplitudes, inside * 100 * decay.damping_ratios, color=colour, ls=style)
    if any(np.isfinite(decay.knee) for decay in drawn):
        first.annotate(
            text("dotted: sliding gives way to sticking"),
            (1, 1),
            xycoords="axes fraction",
            ha="right",
            va="bottom",
            fontsize=7.5,
            color=GREY,
        )
    first.set_xlabel(text("Time [s]"))
    amplitude = text("Amplitude [{unit}]", unit=unit) if unit else text("Amplitude")
    first.set_ylabel(amplitude)
    second.set_ylabel(text("Frequency [Hz]"))
    third.set_ylabel(text("Damping ratio [%]"))
    third.set_xlabel(amplitude)
    _legend(first, drawn, labels)
    return figure


def _readable(decay: Decay) -> np.ndarray:
    """Where frequency and damping are functions of the amplitude: at amplitudes that do not come again (not in a beat),
    and not within a period of the knee, where both jump."""
    new = decay.amplitudes >= np.maximum.accumulate(decay.amplitudes[::-1])[::-1]
    far = ~(np.abs(decay.times - decay.knee) <= 1 / decay.frequencies)
    return np.asarray(new & far & (decay.damping_ratios > 0))


def _legend(axes: Axes, held: Sequence[Decay], labels: Sequence[str]) -> None:
    if len(held) > 1 or labels:
        axes.legend(loc="upper right", ncols=3)


@styled
def tool_point(lines: Sequence[ControlLine], limits: CuttingLimits | None = None) -> Figure:
    """Draw what a controlled normal force brings: energy after a release, and depth of cut over the cutting force.

    Parameters
    ----------
    lines : sequence of ControlLine
        Ring-downs.
    limits : CuttingLimits, optional
        Depths of cut of :func:`ema.simulate.cutting_limits`.

    Returns
    -------
    Figure
        The figure.

    Examples
    --------
    >>> from ema.data import ControlLine, CuttingLimits
    >>> line = ControlLine("constant", 500.0, 0.08, 0.3, 0.4, times=[0.0, 0.1], energies=[1.0, 0.3])
    >>> table = np.array([[4e-3, 2e-3], [2e-3, 5e-3]])
    >>> limits = CuttingLimits([10.0, 40.0], [50.0, 200.0], depth=table, amplitude=table, frequency=table)
    >>> len(tool_point([line], limits).axes)
    2
    """
    figure = new_figure(3.6)
    left, *others = figure.subplots(1, 1 if limits is None else 2, squeeze=False)[0]
    for number, line in enumerate(lines):
        colour, style, _ = SERIES[number % len(SERIES)]
        energies = np.maximum(line.energies, 1e-12)
        left.semilogy(1e3 * line.times, energies, color=colour, ls=style, label=f"{line.law}, {line.force:g} N")
    left.set(
        xlabel=text("Time after the release [ms]"), ylabel=text("Energy over that at the start [-]"), ylim=(1e-5, 1.5)
    )
    left.legend(loc="lower left")
    left.set_title(text("Free vibration"))
    if limits is None:
        return figure
    right = others[0]
    depth = 1e3 * np.where(np.isfinite(limits.depth), limits.depth, np.nan)
    for column in range(depth.shape[1]):
        right.plot(limits.force_levels, depth[:, column], color=FAINT, lw=0.8, zorder=1)
    rows = np.arange(len(limits.force_levels))
    for values, label, (colour, style, marker) in (
        (depth[rows, limits.controlled], text("one F_N for each level"), SERIES[1]),
        (
            depth[:, limits.constant],
            text("{force} N for all", force=f"{limits.normal_forces[limits.constant]:g}"),
            SERIES[0],
        ),
    ):
        right.plot(limits.force_levels, values, color=colour, ls=style, marker=marker, label=label)
    right.set(
        xlabel=text("Amplitude of the cutting force [N]"),
        ylabel=text("Depth at which chatter persists [mm]"),
        xscale="log",
    )
    right.set_ylim(bottom=0)
    right.legend()
    right.set_title(text("In the cut (grey: other constant F_N)"))
    return figure
