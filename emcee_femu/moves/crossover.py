"""Subspace crossover: differences of walkers in some of the parameters only."""

from typing import Any

import numpy as np
from numpy.random import RandomState
from numpy.typing import ArrayLike

from .. import checks
from ..interfaces import Floats
from .guides import convert_sigma, draw_guides, draw_noise
from .red_blue import VectorizedRedBlueMove


class CrossoverMove(VectorizedRedBlueMove):
    r"""Add differences of one to three pairs of walkers, in a random subspace.

    .. math:: \theta^*_j = \theta_{ij} + \gamma \sum_{k=1}^{\delta}
        (\theta_{a_k j} - \theta_{b_k j}) + \varepsilon_j \quad (j \in J), \qquad
        \gamma = \frac{2.38}{\sqrt{2\, \delta\, |J|}}, \qquad
        r = \min\{1, p(\theta^*) / p(\theta_i)\}

    For every walker anew: delta is uniform on 1 to ``pairs``, all members of the pairs
    are distinct walkers among those at rest, a crossover probability is one of those
    given, and each parameter is in J with that probability; if none is, one of them,
    uniformly chosen, is. The other parameters keep their values.

    Crossover hurts on strongly correlated posteriors, such as those of stiffnesses from
    frequencies: a step in few parameters leaves the ridge. On the mass-spring posterior
    of :mod:`emcee_femu.paper` this move gave 25 effective samples per 1000 model
    evaluations, without crossover (``crossover=[1.0]``) 37, :class:`DEMCMove` 37.

    Args:
        pairs: The largest number of pairs, 1 to 3; ``2 * pairs`` walkers must be at
            rest.
        crossover: Probabilities that a parameter moves, above 0 and up to 1.
        sigma: Standard deviation of the noise eps, as for :class:`DEMCMove`.
        nsplits: Parts of the ensemble that move in turn.
        randomize_split: Whether to deal the walkers to the parts anew each step.
        live_dangerously: Whether to allow fewer walkers than ``2 * ndim``.

    Raises:
        TypeError: If an argument does not hold real numbers, or whole ones.
        ValueError: If pairs is not 1 to 3, a probability is not above 0 and up to 1,
            sigma is negative or not finite, or nsplits < 2. When it proposes: if sigma
            does not fit ndim or fewer than ``2 * pairs`` walkers are at rest.

    Source: Vrugt et al. (2009), doi:10.1515/IJNSNS.2009.10.3.273.

    Examples:
        >>> import emcee_femu as ef
        >>> posterior = ef.paper.mass_spring().posterior
        >>> moves = [(ef.DEMCMove(), 0.5), (ef.CrossoverMove(pairs=2), 0.5)]
        >>> (sampler,) = ef.run(posterior, moves, nwalkers=20, nsteps=50, seed=1)
        >>> sampler.get_chain().shape
        (50, 20, 5)
    """

    def __init__(
        self,
        pairs: int = 3,
        crossover: ArrayLike = (1 / 3, 2 / 3, 1.0),
        sigma: ArrayLike | None = None,
        *,
        nsplits: int = 2,
        randomize_split: bool = True,
        live_dangerously: bool = False,
    ) -> None:
        super().__init__(nsplits, randomize_split, live_dangerously)
        self.pairs = checks.whole_number("pairs", pairs, 1)
        if self.pairs > 3:
            raise ValueError(f"pairs: expected 1, 2 or 3, got {pairs}")
        self.guides = 2 * self.pairs
        self._crossover = checks.positive_array("crossover", crossover, 1)
        if not self._crossover.size or (self._crossover > 1).any():
            raise ValueError(
                "crossover: expected one or more probabilities, each above 0 and up "
                f"to 1, got {crossover!r}"
            )
        self.crossover: tuple[float, ...] = tuple(self._crossover.tolist())
        self.sigma = convert_sigma(sigma)

    def get_proposal(
        self, s: Floats, c: list[Floats], random: RandomState
    ) -> tuple[Floats, None]:
        """Propose for walkers ``s (k, ndim)`` with guides ``c[0]`` (emcee's contract).

        The proposal is symmetric, so that there is no Hastings factor.
        """
        guides = np.concatenate(c) if len(c) > 1 else c[0]
        moving, ndim = s.shape
        # Three uniform draws per walker: the number of pairs, the probability, and the
        # parameter that moves if no other does.
        uniform = random.random_sample((3, moving))
        sizes = np.array([[self.pairs], [len(self.crossover)], [ndim]])
        delta, which, only = (uniform * sizes).astype(np.intp)
        delta += 1
        probability = self._crossover.take(which)
        moves = random.random_sample((moving, ndim)) < probability[:, None]
        none = (~moves.any(axis=1)).nonzero()[0]
        moves[none, only[none]] = True

        chosen = draw_guides(random, moving, len(guides), self.guides)
        members = guides.take(chosen, axis=0)  # (2 pairs, moving, ndim)
        members[::2] -= members[1::2]
        used = np.arange(self.pairs)[:, None] < delta  # (pairs, moving)
        step: Floats = np.einsum("pm,pmj->mj", used, members[::2])
        step *= scale_jump(delta, moves.sum(axis=1))[:, None]
        step += draw_noise(self.sigma, guides, moving, random)
        step *= moves
        step += s
        return step, None


def scale_jump(pairs: Any, parameters: Any) -> Any:
    r"""Return gamma for a number of pairs and of moved parameters.

    .. math:: \gamma = 2.38 / \sqrt{2\, \delta\, d'}
    """
    return 2.38 / np.sqrt(2 * pairs * parameters)
