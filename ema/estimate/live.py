"""A verdict on one take of a hammer test while the next impact can still be repeated."""

import warnings
from dataclasses import replace

from ema.data import Finding, Recording
from ema.estimate import channels, hammer_findings
from ema.estimate.channel_swap import probably_swapped
from ema.estimate.judge import judge_record


def check_impact(recording: Recording, trigger: float | None = None) -> tuple[Finding, ...]:
    """Check the impacts of a take; an error among the findings means that the take should be repeated.

    Parameters
    ----------
    recording : Recording
        One force channel and one or more responses, with one impact or many.
    trigger : float, optional
        Force [N] above its offset that counts as an impact; by default from the noise and the strongest impact.

    Returns
    -------
    tuple of Finding
        What is wrong with the impacts.

    Raises
    ------
    InputError
        If the take cannot be judged: no force or response channel, too short, or not a number.

    Examples
    --------
    >>> import numpy as np
    >>> from ema.examples import recording
    >>> [finding.code for finding in check_impact(recording(np.zeros(2048)))]
    ['no-trigger']
    """
    where = "take" if not recording.name else f"take {recording.name}"
    layout = channels.layout(recording, where)
    channels.finite(recording, layout, where)
    judged = [replace(one, used=one.clean) for one in judge_record(recording, layout, 0, trigger)]
    response = probably_swapped(recording, layout)
    swapped = [] if response is None else [(recording.channels[layout.references[0]].name, response)]
    findings = [
        *hammer_findings.about_swap(swapped, 1, where),
        *hammer_findings.about_force(judged, where),
        *hammer_findings.about_impacts(judged, "take"),
    ]
    if any(one.used for one in judged):
        return tuple(findings)
    nothing = "the force channel never triggers" if not judged else "no impact of this take is without fault"
    code = "no-trigger" if not judged else "no-impact"
    return (Finding("error", code, where, f"{nothing}.", None, None, "Strike again."), *findings)


def check_hit(recording: Recording, trigger: float | None = None) -> tuple[Finding, ...]:
    """Check the impacts of a take; the former name of :func:`check_impact`.

    Parameters
    ----------
    recording : Recording
        As :func:`check_impact`.
    trigger : float, optional
        As :func:`check_impact`.

    Returns
    -------
    tuple of Finding
        As :func:`check_impact`.

    Examples
    --------
    >>> import warnings
    >>> from ema.examples import recording
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", DeprecationWarning)
    ...     check_hit(recording()) == check_impact(recording())
    True
    """
    warnings.warn("ema.estimate.check_hit is called check_impact", DeprecationWarning, stacklevel=2)
    return check_impact(recording, trigger)
