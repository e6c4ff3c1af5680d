from ema.proposal.proposal import Proposal as Proposal
from ema.proposal.proposal import propose as propose
from ema.proposal.questions import Question as Question
