"""A proposal: a mixture whose components are known by what they are for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..contracts import Floats
from ..moves.mixture import COVER_WEIGHT, Mixture

Labels: TypeAlias = NDArray[np.intp]

# The purposes of components.
CORE = "core"
DEFENSIVE = "defensive"
TAIL = "tail"
CARRIER = "carrier"

# What surrounds other components is wider than they are by this factor.
WIDER = 2.0
# Largest total weight of components that are added at once.
MOST_ADDED = 0.35
# Squared distance of two centres, relative to the sum of their matrices, from which
# components belong to separate maxima.
MAXIMA_APART = 10.0
# The maximum of the defensive component, which belongs to none.
NO_MAXIMUM = -1


class Component(NamedTuple):
    """A component to be added: weight, mean ``(d,)``, scale matrix ``(d, d)``.

    The numbers are in the coordinates of the mixture to which it is added.
    """

    weight: float
    mean: Floats
    matrix: Floats


@dataclass(frozen=True, eq=False)
class Proposal:
    """A mixture inside a wide component, with what each component is for.

    Attributes:
        core: The mixture without the wide component.
        kinds: What each component of it is for, ``(k,)``: "core" if it was fitted to
            the draws, "tail" or "carrier" if it was added where draws lacked.
    """

    core: Mixture
    kinds: NDArray[np.str_]

    @classmethod
    def fitted(cls, core: Mixture) -> Self:
        """Return the proposal of a mixture that was fitted to draws."""
        return cls(core, np.full(len(core.weights), CORE))

    @cached_property
    def law(self) -> Mixture:
        """The mixture that is drawn from, with the defensive component.

        It bounds the importance weights where the others leave gaps, and in the tails
        (Hesterberg 1995, doi:10.1080/00401706.1995.10484303).
        """
        core = self.core
        mean = core.weights @ core.means
        apart = core.means - mean
        spread = (core.weights * apart.T) @ apart * (core.df - 2) / core.df
        wide = np.einsum("k,kij->ij", core.weights, core.matrices) + spread
        defence = Component(COVER_WEIGHT, mean, WIDER**2 * wide)
        return add_components(core, [defence])

    @property
    def law_kinds(self) -> NDArray[np.str_]:
        """What each component of the law is for."""
        return np.append(self.kinds, DEFENSIVE)

    @property
    def undefended(self) -> Mixture:
        """The law of draws that do not come from the defensive component."""
        return self.law.given(self.law_kinds != DEFENSIVE)

    def extended(self, added: Sequence[Component], kind: str) -> Self:
        """Return the proposal with more components of a kind."""
        kinds = np.append(self.kinds, [kind] * len(added))
        return type(self)(add_components(self.undefended, added), kinds)

    def separate(self) -> Labels:
        """Return the maximum of each component; components that overlap share one.

        A carrier may span several maxima, so it does not join them. Components for
        tails and carriers make no maximum of their own: they belong to that of the
        nearest fitted component. The defensive component belongs to none.
        """
        means, matrices = self.core.means, self.core.matrices
        apart, sums = means[:, None] - means, matrices[:, None] + matrices
        solved = np.linalg.solve(sums, apart[..., None]).squeeze(-1)
        squares = np.einsum("ijd,ijd->ij", apart, solved)
        local, fitted = self.kinds != CARRIER, np.flatnonzero(self.kinds == CORE)
        joined = (squares < MAXIMA_APART) & local & local[:, None]
        groups = connected_components(joined, directed=False)[1]
        owners = groups[fitted[squares[:, fitted].argmin(axis=1)]]
        labels = np.full(len(self.law_kinds), NO_MAXIMUM, dtype=np.intp)
        labels[self.law_kinds != DEFENSIVE] = np.unique(owners, return_inverse=True)[1]
        return labels


def add_components(mixture: Mixture, added: Sequence[Component]) -> Mixture:
    """Return a mixture with more components."""
    weights, means, matrices = map(np.array, zip(*added, strict=True))
    weights = weights * min(1.0, MOST_ADDED / weights.sum())
    return replace(
        mixture,
        weights=np.append((1 - weights.sum()) * mixture.weights, weights),
        means=np.vstack([mixture.means, means]),
        matrices=np.concatenate([mixture.matrices, matrices]),
    )


def assign(theta: Floats, law: Mixture, labels: Labels) -> Labels:
    """Return the maximum of each point ``(n,)``: that of its likeliest component.

    Args:
        theta: Points ``(n, d)``.
        law: A mixture.
        labels: The maximum of each of its components, as :meth:`Proposal.separate` has
            them.
    """
    owners = np.flatnonzero(labels != NO_MAXIMUM)
    likeliest = np.argmax(law.log_parts(theta)[:, owners], axis=1)
    return np.asarray(labels[owners][likeliest])
