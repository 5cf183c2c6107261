"""Foreign policies: networks that were trained elsewhere, driven as their makers intended."""

from surefoot.agents.foreign.interface import Interface, Term
from surefoot.agents.foreign.network import Network
from surefoot.agents.foreign.observations import OBSERVATIONS, Moment, Observation
from surefoot.agents.foreign.policy import ForeignPolicy

__all__ = ["OBSERVATIONS", "ForeignPolicy", "Interface", "Moment", "Network", "Observation", "Term"]
