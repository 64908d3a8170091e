"""A campaign: all that the stages of a search read and write."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..contracts import Floats
from ..evaluation.evaluator import Evaluation
from ..moves.mixture import Mixture
from ..posterior.log_posterior import LogPosterior
from ..posterior.priors import prior_centre
from .archive import Archive, JudgedProposal
from .coordinates import Coordinates
from .ledger import Ledger
from .maxima import Maxima
from .proposal import Component, Proposal
from .record import Annealed
from .response_surface import ResponseSurface, degree_of
from .settings import SETTINGS, Settings

# Factor of the weights of components for tails and carriers where a mixture fits so
# badly that polynomials are learned from its draws, which must reach the ends of a
# ridge. (Of 14 buildings of ten storeys 13 converged; without it 10.)
WEIGHED_WHERE_BENT = 2.0


@dataclass(frozen=True)
class Sizes:
    """How many points and draws the stages take.

    Attributes:
        points: Points of the exploration.
        batch: Fewest draws of a round of the refinement.
        refined: Solves after which no round of a refinement begins.
        judged: Number of draws by which a proposal is judged.
        chain: Evaluations that the chain will take; if they are not known, those for
            which a search is sized.
    """

    points: int
    batch: int
    refined: int
    judged: int
    chain: int


@dataclass(eq=False)
class Campaign:
    """A search under way. A stage is a function of it, and returns nothing.

    Attributes:
        evaluator: Evaluates the posterior.
        streams: A random stream for each ensemble.
        ledger: The solves that each stage may spend, and has spent.
        sizes: How many points and draws the stages take.
        starts: Points ``(n, d)`` of each ensemble that are searched too, or None.
        settings: The numbers that steer the search.
        archive: All draws, weighted.
        maxima: The maxima that were found.
        proposal: The present proposal. The attribute is not set before the
            exploration has ended.
        best: The best proposal so far, with the draws that judged it.
        points: How many points were explored.
        first_share: Effective share of the first refined mixture, before components
            for tails and carriers were added; NaN until then.
        surface: The response surface that screens proposals, where there is one.
        populations: An annealed population of each ensemble, if any were annealed.
        by_gradients: Whether trajectories do better than independence proposals.
    """

    evaluator: Evaluation
    streams: Sequence[np.random.Generator]
    ledger: Ledger
    sizes: Sizes
    starts: Sequence[Floats] | None = None
    settings: Settings = SETTINGS
    archive: Archive = field(init=False)
    maxima: Maxima = field(init=False)
    proposal: Proposal = field(init=False)
    best: JudgedProposal = field(init=False)
    points: int = 0
    first_share: float = np.nan
    surface: ResponseSurface | None = None
    populations: list[Annealed] = field(default_factory=list)
    by_gradients: bool = False

    def __post_init__(self) -> None:
        """Begin with an empty archive."""
        self.archive = Archive(self.posterior.ndim)
        self.maxima = Maxima(len(self.streams), self.coordinates)

    @cached_property
    def coordinates(self) -> tuple[NDArray[np.bool_] | None, ...]:
        """The parameters that a mixture may take logarithms of: none, or all possible.

        It may where the prior allows only positive values and has no density at zero.
        Otherwise the density of the logarithm has an exponential tail towards zero,
        which is heavier than the tail of a mixture fitted to draws.
        """
        prior = self.posterior.prior
        logs = Coordinates.positive(prior).logs
        at_zero = np.where(np.eye(len(logs), dtype=bool), 0.0, prior_centre(prior))
        with np.errstate(all="ignore"):
            logs &= np.isneginf(prior.logpdf(at_zero))
        return (None, logs) if logs.any() else (None,)

    @property
    def posterior(self) -> LogPosterior:
        """The posterior that is searched."""
        return self.evaluator.posterior

    @property
    def bendable(self) -> bool:
        """Whether polynomials of the response can be learned."""
        return self.posterior.normal and degree_of(self.posterior.ndim) > 1

    @property
    def bent(self) -> bool:
        """Whether such polynomials may do better than mixtures."""
        return self.bendable and self.first_share < self.settings.bent

    @property
    def heavy(self) -> float:
        """Factor of the weights of components for tails and carriers."""
        return WEIGHED_WHERE_BENT if self.bent else 1.0

    def draw(self, law: Mixture, number: int) -> tuple[Floats, Floats]:
        """Return draws of a law, equally many from each stream, and their rows."""
        each = -(-number // len(self.streams))
        theta = np.concatenate([law.draw(rng, each) for rng in self.streams])
        return theta, self.evaluator.rows(theta)

    def extend(self, added: Sequence[Component], kind: str, number: int) -> None:
        """Add components to the proposal, after drawing from these alone."""
        law = self.proposal.law
        weights, means, matrices = map(np.array, zip(*added, strict=True))
        alone = Mixture(weights / weights.sum(), means, matrices, law.df)
        alone = alone.seen_in(law.logs)
        self.archive.add(*self.draw(alone, number), alone)
        parts = map(Component, weights, alone.means, alone.matrices)
        self.proposal = self.proposal.extended([*parts], kind)


Stage: TypeAlias = Callable[[Campaign], None]
