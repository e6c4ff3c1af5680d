"""What the files do not say: one question at a time, each with a default and the reason for it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

AT_MOST = 3
"""Questions that a folder is asked; what is left takes its default and is marked in the file. More would be a form."""


@dataclass(frozen=True)
class Question:
    """A question to the person who measured.

    Parameters
    ----------
    key : str
        Names the answer (``ema init --answer KEY=TEXT``).
    text : str
        The question.
    default : str, optional
        Answer that is taken where none is given; without one nothing can be computed before it is answered.
    choices : tuple of str, optional
        All answers allowed; empty where the text is free.
    evidence : str, optional
        What in the files leads to the question.

    Examples
    --------
    >>> Question("unit", "In which unit are the coordinates?", default="m", choices=("m", "mm")).required
    False
    """

    key: str
    text: str
    default: str = ""
    choices: tuple[str, ...] = ()
    evidence: str = ""

    @property
    def required(self) -> bool:
        """Whether there is no default."""
        return not self.default


@dataclass
class Answers:
    """Answers given so far; what is asked beyond them is noted, in the order in which it came up."""

    given: Mapping[str, str] = field(default_factory=dict)
    asked: list[Question] = field(default_factory=list)

    def ask(self, question: Question) -> str:
        """The answer, or the default where none was given; the question is noted in either case."""
        if all(one.key != question.key for one in self.asked):
            self.asked.append(question)
        return self.given.get(question.key, "") or question.default

    def known(self, key: str) -> bool:
        """Whether somebody answered it."""
        return bool(self.given.get(key))

    @property
    def open(self) -> tuple[Question, ...]:
        """What is still to be asked, the indispensable first, so that all answers together are ``AT_MOST``."""
        left = [one for one in self.asked if one.key not in self.given]
        left.sort(key=lambda one: not one.required)
        return tuple(left[: max(AT_MOST - len(self.given), 0)])

    @property
    def assumed(self) -> tuple[Question, ...]:
        """Questions that nobody answered."""
        return tuple(one for one in self.asked if not self.known(one.key))
