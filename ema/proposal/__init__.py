"""What a folder of measurements holds, and the ``campaign.toml`` that says so."""

from ema.public import attach

_HOMES = {
    "Proposal": "ema.proposal.proposal",
    "Question": "ema.proposal.questions",
    "propose": "ema.proposal.proposal",
}

__getattr__, __dir__, __all__ = attach(__name__, _HOMES)
