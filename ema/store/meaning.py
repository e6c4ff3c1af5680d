"""What the numbers of an array mean: quantity, unit and long name, written beside it in the file."""

from dataclasses import dataclass
from typing import Any

from ema.units import SI_UNIT


@dataclass(frozen=True)
class Meaning:
    """Attributes of a stored array; a tuple of units belongs to the rows of the array."""

    quantity: str | tuple[str, ...] = ""
    unit: str | tuple[str, ...] = ""
    long_name: str = ""


_POLES = Meaning("pole", "rad/s", "poles, positive imaginary part")
_FIXED: dict[tuple[str, str], Meaning] = {
    ("FrfSet", "frequencies"): Meaning("frequency", "Hz", "frequency lines"),
    ("FrfSet", "coherence"): Meaning("coherence", "1", "coherence (freq, out, in)"),
    ("FrfSet", "averages"): Meaning("count", "1", "averages behind each FRF (out, in)"),
    ("Deviations", "values"): Meaning("deviation", "", "of the average by single impacts (impact, freq, out, in)"),
    ("Deviations", "blows"): Meaning("number", "1", "numbers of the impacts (impact, out, in)"),
    ("PoleTable", "poles"): _POLES,
    ("PoleTable", "values"): Meaning("pole", "rad/s", "poles read with the low-bias constraint"),
    ("PoleTable", "order"): Meaning("count", "1", "model order"),
    ("PoleTable", "participation"): Meaning("participation", "1", "participation vectors (pole, in)"),
    ("ModalModel", "poles"): _POLES,
    ("ModalModel", "shapes"): Meaning("mode shape", "", "mode shapes (dof, mode)"),
    ("ModalModel", "participation"): Meaning("participation", "", "participation (in, mode)"),
    ("ModalModel", "covariance"): Meaning("covariance", "Hz, 1", "of natural frequency and damping ratio"),
    ("ModalModel", "confidence"): Meaning("confidence", "1", "confidence of the selection"),
    ("Residuals", "poles"): Meaning("pole", "rad/s", "out-of-band and computational poles"),
    ("Geometry", "nodes"): Meaning("node number", "1", "node numbers"),
    ("Geometry", "xyz"): Meaning("length", "m", "coordinates of the nodes"),
    ("Geometry", "axes"): Meaning("direction", "1", "local axes (node, axis, component)"),
    ("JointForce", "trace"): Meaning("force", "N", "normal force of the joint"),
    ("JointForce", "trace_times"): Meaning("time", "s", "time from the start of the run"),
    ("Hit", "pulse"): Meaning("force", "N", "force around the impact"),
    ("HitGallery", "frequencies"): Meaning("frequency", "Hz", "frequency lines"),
    ("HitGallery", "force_spectrum"): Meaning("energy spectral density", "N^2 s^2", "force autospectrum"),
    ("ModalMap", "force_levels"): Meaning("force", "N", "nominal excitation force"),
    ("ModalMap", "normal_forces"): Meaning("force", "N", "nominal normal force"),
    ("ModalMap", "frequency"): Meaning("frequency", "Hz", "natural frequency (level, force)"),
    ("ModalMap", "damping"): Meaning("damping ratio", "1", "modal damping ratio (level, force)"),
    ("ModalMap", "frequency_std"): Meaning("frequency", "Hz", "standard deviation of the natural frequency"),
    ("ModalMap", "damping_std"): Meaning("damping ratio", "1", "standard deviation of the damping ratio"),
    ("ModalMap", "force_at_resonance"): Meaning("force", "N", "measured excitation force at resonance"),
    ("ModalMap", "modal_amplitude"): Meaning("modal amplitude", "m kg^0.5", "mass-normalised modal amplitude"),
    ("ModalMap", "joint_forces"): Meaning("force", "N", "measured normal force (level, force, joint)"),
    ("SteppedLevel", "frequencies"): Meaning("frequency", "Hz", "frequency lines"),
    ("SteppedLevel", "force"): Meaning("force", "N", "amplitude of the force"),
    ("AmplitudeDependentMode", "force"): Meaning("force", "N", "force at resonance (level)"),
    ("ModeQuality", "modal_phase_collinearity"): Meaning("indicator", "1", "modal phase collinearity"),
    ("ModeQuality", "mean_phase"): Meaning("angle", "deg", "mean phase"),
    ("ModeQuality", "mean_phase_deviation"): Meaning("angle", "deg", "mean phase deviation"),
}


def meaning(container: Any, field: str) -> Meaning:
    """What the array in ``field`` of ``container`` means; empty where nothing is known."""
    match type(container).__name__, field:
        case "FrfSet", "values":
            return Meaning(container.quantity, container.unit, "frequency response functions (freq, out, in)")
        case "FrfSet", "variance":
            return Meaning("variance", f"({container.unit})^2", "variance of the complex FRF (freq, out, in)")
        case "Recording", "signals":
            return Meaning(
                tuple(channel.quantity for channel in container.channels),
                tuple(channel.unit if channel.unit else SI_UNIT[channel.quantity] for channel in container.channels),
                "time signals (channel, sample)",
            )
        case name, _:
            return _FIXED.get((name, field), Meaning())
    return Meaning()
