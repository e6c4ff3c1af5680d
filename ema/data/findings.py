"""A problem in a measurement is data, and reaches the report."""

from dataclasses import dataclass, replace
from typing import Literal

from ema.data._summary import Container
from ema.messages import SOURCE, language, text, word

Severity = Literal["info", "warning", "error"]


@dataclass(frozen=True, repr=False, slots=True)
class Finding(Container):
    """One thing that a reader of the results has to know.

    Parameters
    ----------
    severity : {"info", "warning", "error"}
        ``info`` (good to know), ``warning`` (look at it), ``error`` (do not use without a repair).
    code : str
        Short stable name, such as ``"double-hit"`` or ``"low-coherence"``; one for each kind of finding.
    where : str
        What it concerns, such as ``"run beam_1kN, point 12:+Z, hit 3"``.
    message : str
        One sentence that states the fact with its numbers, in English.
    value : float, optional
        The measured number, SI; ``None`` where there is none.
    limit : float, optional
        The number that it was compared with, SI; ``None`` where there is none.
    advice : str, optional
        One sentence that a test engineer can act on, in English.
    templates : tuple of str, optional
        Message and advice with placeholders for the ``values``, which another language is found by; none where they
        have no placeholders, and in files of earlier versions.
    values : tuple of (str, str), optional
        Placeholders of the templates, with what stands in them.

    Examples
    --------
    >>> print(Finding("warning", "low-coherence", "run bare", "Coherence 0.41 at 499 Hz.", value=0.41, limit=0.8))
    run bare: Coherence 0.41 at 499 Hz.
    """

    severity: Severity
    code: str
    where: str
    message: str
    value: float | None = None
    limit: float | None = None
    advice: str = ""
    templates: tuple[str, ...] = ()
    values: tuple[tuple[str, str], ...] = ()

    @classmethod
    def of(
        cls,
        severity: Severity,
        code: str,
        where: str,
        message: str,
        *numbers: float | None,
        advice: str = "",
        **values: object,
    ) -> "Finding":
        """Return a finding whose sentences are rendered late, in the language of their reader.

        Parameters
        ----------
        severity, code, where : str
            As the fields of a finding.
        message : str
            The sentence in English, written out, with placeholders such as ``{frequency}``.
        *numbers : float or None
            Value and limit, as the fields of a finding.
        advice : str, optional
            What to do, with placeholders too.
        **values : object
            What stands in the placeholders; words that were marked for translation are translated with the sentence.

        Returns
        -------
        Finding
            The finding.

        Examples
        --------
        >>> coherence = Finding.of(
        ...     "warning", "low-coherence", "run bare", "the median coherence is {median}.", 0.41, median=f"{0.41:.2f}"
        ... )
        >>> coherence.message
        'the median coherence is 0.41.'
        """
        given = {name: str(value) for name, value in values.items()}
        said = message.format(**given), advice.format(**given)
        templates = (message, advice) if given else ()
        value, limit = (*numbers, None, None)[:2]
        return cls(severity, code, where, said[0], value, limit, said[1], templates, tuple(given.items()))

    def in_words(self) -> "Finding":
        """Return the finding with message and advice in the reader's language, as far as it has the sentences.

        Returns
        -------
        Finding
            The finding for the reader.

        Examples
        --------
        >>> from ema.messages import speaking
        >>> coherence = Finding.of(
        ...     "warning", "low-coherence", "run bare", "the median coherence is {median}.", 0.41, median=f"{0.41:.2f}"
        ... )
        >>> with speaking("de"):
        ...     coherence.in_words().message
        'die mittlere Kohärenz (Median) ist 0.41.'
        """
        if language() == SOURCE:
            return self
        if not self.templates:
            return replace(self, message=word(self.message), advice=word(self.advice))
        message, advice = self.templates
        values = {name: word(value) for name, value in self.values}
        return replace(self, message=text(message, **values), advice=text(advice, **values) if advice else "")

    def __str__(self) -> str:
        return f"{self.where}: {self.message}" + (f" {self.advice}" if self.advice else "")
