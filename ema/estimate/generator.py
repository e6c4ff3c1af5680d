"""FRFs with the signal of the generator as reference of force and responses, ``H = S_yr / S_xr``.

H1 takes the measured force for the one that acts, and for independent of what disturbs the responses. Neither holds
on a shaker: the structure pulls the force down at its resonances, where noise of the force channel then is a large
share of it, and what acts on the structure beside the shaker comes back into the force. The signal r that drives the
amplifier knows of neither: as an instrument it makes the FRF consistent (Wellstead 1981; Mitchell, Cobb, Deel and Luk
1988, Hc).

With the error ``e = y - H x`` of the response y to the force x, sums over n independent averages give

    H^ - H = S_er / S_xr,    var H^ = S_ee S_rr / (n |S_xr|^2) = S_ee / (n S_xx coh_xr),

because e is independent of r; with r = x it is the variance of H1 (Bendat and Piersol 2010, eq. 9.90). For several
shakers with as many generators x and r are vectors, and ``S_xr`` and ``S_rr`` matrices.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Complex, Float

from ema.data import Deviations, Finding
from ema.errors import InputError
from ema.estimate import spectra, spectra_parts
from ema.estimate.channels import Layout
from ema.estimate.local_model import WEAKEST, weakness
from ema.estimate.spectra import Spectra

NAME = "Hc"
"""What FRFs with a generator as reference are called in the literature."""

FEW = 0.02
"""Share of the lines on which a force may be without its generator before that is named. One line in fifty is the least
that a test of 5 % leaves alone where neighbouring lines are smoothed; ten times as much hides a mode."""


@dataclass(frozen=True)
class Joint:
    """Averaged spectra whose inputs are forces first and then as many signals of generators."""

    spectra: Spectra

    @property
    def count(self) -> int:
        """Number of forces, and of generators."""
        return int(self.spectra.inputs.shape[1]) // 2

    @property
    def forces(self) -> Spectra:
        """The spectra of the forces and responses alone."""
        number, all_ = self.count, self.spectra
        parts = tuple(Joint(part).forces for part in all_.parts)
        return replace(all_, inputs=all_.inputs[:, :number, :number], cross=all_.cross[:, :, :number], parts=parts)

    @property
    def of_generators(self) -> Spectra:
        """The spectra of force and response with the generators: forces as inputs, ``S_xr`` and ``S_yr``."""
        number, all_ = self.count, self.spectra
        return replace(all_, inputs=all_.inputs[:, :number, number:], cross=all_.cross[:, :, number:], parts=())


def check_layout(layout: Layout, where: str) -> None:
    """Refuse generators that are not one for each force.

    Raises
    ------
    InputError : there are some, and more or fewer than forces.
    """
    if layout.generators and len(layout.generators) != len(layout.references):
        raise InputError(
            "there is not one generator for each force",
            where=where,
            got=f"{len(layout.generators)} channels with role generator, {len(layout.references)} forces",
            expected="as many generators as forces, or none",
            advice="set the role of the others to 'other'",
        )


def per_force(joint: Joint) -> Complex[np.ndarray, "freq in in"]:
    """``S_xr^-1``; zeros where a force or a generator has no power."""
    return np.asarray(np.linalg.pinv(joint.of_generators.inputs))


def frfs(joint: Joint) -> Complex[np.ndarray, "freq out in"]:
    """``S_yr S_xr^-1``.

    Examples
    --------
    As much noise as signal in the force: H1 is half of the FRF, the generator has all of it.

    >>> one = np.ones((1, 1, 1), complex)
    >>> inputs = np.array([[[2.0, 1.0], [1.0, 1.0]]], complex)
    >>> joint = Joint(Spectra(inputs=inputs, cross=np.ones((1, 1, 2), complex), outputs=np.ones((1, 1)), averages=100))
    >>> round(float(spectra.frf(joint.forces)[0, 0, 0].real), 3), round(float(frfs(joint)[0, 0, 0].real), 3)
    (0.5, 1.0)
    """
    return np.asarray(joint.of_generators.cross @ per_force(joint))


def weakness_of(joint: Joint) -> Float[np.ndarray, "freq in"]:
    """How weakly the generators determine each force on each line (:func:`ema.estimate.local_model.weakness`)."""
    found, number = joint.spectra, joint.count
    of_force = Spectra(
        found.inputs[:, number:, number:],
        found.inputs[:, :number, number:],
        spectra.input_power(found)[:, :number],
        found.averages,
    )
    values = spectra.frf(of_force)
    variance = spectra.variance(of_force, spectra.multiple_coherence(of_force, values), 1)
    if variance is None:
        return np.full((len(values), number), np.inf)
    return weakness(np.linalg.pinv(values), np.where(np.isfinite(variance), variance, 0.0))


def welch_frfs(joint: Joint, kept: Bool[np.ndarray, "freq"]) -> dict[str, Any]:
    """FRFs, coherence of the responses with the generators, variance and averages on the ``kept`` lines."""
    found, number, values = joint.spectra, joint.count, frfs(joint)
    weak = weakness_of(joint)
    coherence = spectra.multiple_coherence(
        replace(found, inputs=found.inputs[:, number:, number:], cross=found.cross[:, :, number:])
    )
    result = {
        "values": values[kept],
        "coherence": np.repeat(coherence[kept, :, None], number, axis=2),
        "variance": None,
        "averages": np.full(values.shape[1:], found.averages),
        "weakness": weak[kept],
    }
    if found.averages <= number:
        return result
    result["variance"] = _variance(joint, values, weak)[kept]
    changes = _deviations(joint, values)
    if changes is None:
        return result
    return result | {
        "deviations": replace(changes, values=np.asarray(changes.values)[:, kept]),
        "output_correlation": spectra_parts.output_correlation(values, changes)[kept],
    }


def _variance(
    joint: Joint, values: Complex[np.ndarray, "freq out in"], weak: Float[np.ndarray, "freq in"]
) -> Float[np.ndarray, "freq out in"]:
    """``S_ee / (n - m)`` times the diagonal of ``S_xr^-H S_rr S_xr^-1``, for m forces."""
    found, number = joint.spectra, joint.count
    # S_ee = S_yy - 2 Re(H S_xy) + H S_xx H^H
    power = found.outputs - 2 * np.einsum("foi,foi->fo", values.conj(), joint.forces.cross).real
    power += np.einsum("foi,fij,foj->fo", values, joint.forces.inputs, values.conj()).real
    noise = pooled(np.maximum(power, 0.0), values, spectra_parts.pooled_lines(found.averages))
    inverse = per_force(joint)
    gain = np.einsum("fri,frs,fsi->fi", inverse.conj(), found.inputs[:, number:, number:], inverse).real
    widened = gain / (1 - np.minimum(weak, WEAKEST)) ** 2
    return np.asarray(noise[:, :, None] / (found.averages - number) * widened[:, None, :])


def pooled(
    power: Float[np.ndarray, "freq out"], values: Complex[np.ndarray, "freq out in"], lines: int
) -> Float[np.ndarray, "freq out"]:
    """Power of the errors over neighbouring lines, for noise that is flat or has the shape of the FRFs.

    Noise of a response is alike on neighbouring lines, noise of a force goes with |H|^2: of the two means, the larger.
    """
    size = np.sum(np.abs(values) ** 2, axis=2)
    with_frf = spectra.smooth_lines(power * size, lines) / np.maximum(
        spectra.smooth_lines(size**2, lines), np.finfo(float).tiny
    )
    return np.asarray(np.maximum(spectra.smooth_lines(power, lines), with_frf * size))


def _deviations(joint: Joint, values: Complex[np.ndarray, "freq out in"]) -> Deviations | None:
    """What the parts change, ``(S_yr,i - H S_xr,i) S_xr^-1``, scaled as in `ema.estimate.spectra_parts`."""
    parts = joint.spectra.parts
    if len(parts) < 2:
        return None
    inverse, tiny = per_force(joint), np.finfo(float).tiny
    power = np.maximum(spectra.input_power(joint.spectra), tiny)[:, joint.count :]
    changes = np.empty((len(parts), *values.shape), np.complex64)
    apart = 0.0
    for change, part in zip(changes, parts, strict=True):
        own = Joint(part).of_generators
        share = spectra.input_power(part)[:, joint.count :] / power
        left = np.sqrt(1 - np.minimum(np.mean(share, axis=1), 1 - 1e-9))
        change[...] = (own.cross - values @ own.inputs) @ inverse / left[:, None, None]
        apart += float(np.mean(share)) ** 2 / part.averages
    changes *= np.sqrt(1 / (joint.spectra.averages * apart))
    numbers = np.broadcast_to(np.arange(len(changes))[:, None, None], (len(changes), *values.shape[1:]))
    return Deviations(changes, numbers)


def about_generators(
    weak: Float[np.ndarray, "freq in"], frequencies: Float[np.ndarray, "freq"], inputs: Sequence[object], where: str
) -> tuple[Finding, ...]:
    """A finding for each force that its generator does not determine on some lines.

    Raises
    ------
    InputError : on most lines: the channel is not the one that drives the shaker.
    """
    findings = []
    for column, force in enumerate(inputs):
        lost = weak[:, column] >= 1
        share = float(np.mean(lost))
        if share > 0.5:
            raise InputError(
                "the force does not follow the signal of the generator",
                where=f"{where}, force at {force}",
                got=f"no significant coherence between them at {100 * share:.0f} % of the lines",
                expected="the signal that drives this shaker",
                advice="correct the channel with role generator in campaign.toml, or set its role to 'other'",
            )
        if share > FEW:
            findings.append(
                Finding.of(
                    "warning",
                    "generator-coherence",
                    f"{where}, force at {force}",
                    "at {share} % of the lines ({bands}) the force does not follow the generator significantly: the "
                    "FRFs there are not determined, and their variance is large.",
                    share,
                    FEW,
                    advice="Average more, or drive more strongly in these bands.",
                    share=f"{100 * share:.0f}",
                    bands=bands_of(frequencies, lost),
                )
            )
    return tuple(findings)


def bands_of(frequencies: Float[np.ndarray, "freq"], chosen: Bool[np.ndarray, "freq"], most: int = 4) -> str:
    """The bands of chosen lines in words, the widest first: ``61.5-63 Hz, 120 Hz, ...``.

    Examples
    --------
    >>> bands_of(np.arange(6.0), np.array([True, True, False, False, True, False]))
    '0-1 Hz, 4 Hz'
    """
    lines = np.flatnonzero(chosen)
    runs = [run for run in np.split(lines, np.flatnonzero(np.diff(lines) > 1) + 1) if len(run)]
    runs.sort(key=len, reverse=True)

    def text(run: np.ndarray) -> str:
        low, high = (f"{frequencies[line]:.4g}" for line in run[[0, -1]])
        return f"{low} Hz" if low == high else f"{low}-{high} Hz"

    return ", ".join(map(text, runs[:most])) + (", ..." if len(runs) > most else "")
