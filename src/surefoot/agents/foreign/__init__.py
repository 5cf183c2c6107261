"""Foreign policies: networks that were learned elsewhere, driven as their makers meant them to be."""

from surefoot.agents.foreign.interface import Interface, Term
from surefoot.agents.foreign.network import Network
from surefoot.agents.foreign.observations import OBSERVATIONS, Moment, Observation
from surefoot.agents.foreign.policy import ForeignPolicy

__all__ = ["OBSERVATIONS", "ForeignPolicy", "Interface", "Moment", "Network", "Observation", "Term"]
