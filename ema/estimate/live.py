"""A verdict on one take of a hammer test while the next blow can still be repeated."""

from ema.data import Finding, Recording
from ema.estimate import channels, hammer_findings
from ema.estimate.judge import judge_record


def check_hit(recording: Recording, trigger: float | None = None) -> tuple[Finding, ...]:
    """What is wrong with the blows of a take; an error among it means that no blow can be used.

    Parameters
    ----------
    recording : one force channel and one or more responses, with one blow or many.
    trigger : force in N above its offset that counts as a blow; by default found from the noise and the strongest blow.

    Raises
    ------
    InputError : the take cannot be judged: no force or response channel, too short, or not a number.
    """
    where = "take" if not recording.name else f"take {recording.name}"
    layout = channels.layout(recording, where)
    channels.finite(recording, layout, where)
    judged = judge_record(recording, layout, 0, trigger)
    findings = [*hammer_findings.about_force(judged, where), *hammer_findings.about_blows(judged, "take")]
    if any(one.accepted for one in judged):
        return tuple(findings)
    nothing = "the force channel never triggers" if not judged else "no blow of this take can be used"
    code = "no-trigger" if not judged else "no-blow"
    return (Finding("error", code, where, f"{nothing}.", None, None, "Strike again."), *findings)
