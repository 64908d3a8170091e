"""A proposal: a mixture whose components are known by what they are for."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from ..contracts import Floats
from ..moves.mixture import Mixture

Labels: TypeAlias = NDArray[np.intp]

# What a component is for.
CORE = "core"
DEFENSIVE = "defensive"
TAIL = "tail"
CARRIER = "carrier"

# Weights of the defensive components, and their widths by that of the core. They bound
# the importance weights where the others leave gaps, and in the tails (Hesterberg 1995,
# doi:10.1080/00401706.1995.10484303).
DEFENCE = ((0.05, 1.5), (0.05, 3.0))
# Weight of all components that are added at once.
MOST_ADDED = 0.35
# Squared distance of two centres, by the sum of the matrices, from which components
# belong to separate maxima.
MAXIMA_APART = 10.0
# The maximum of a defensive component, which belongs to none.
NO_MAXIMUM = -1


class Component(NamedTuple):
    """A component to be added: weight, mean ``(d,)``, scale matrix ``(d, d)``."""

    weight: float
    mean: Floats
    matrix: Floats


@dataclass(frozen=True, eq=False)
class Proposal:
    """A mixture inside two wide components, with what each component is for.

    Attributes:
        core: The mixture without the wide components.
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
        """The mixture from which is drawn, with the defensive components."""
        core = self.core
        mean = core.weights @ core.means
        apart = core.means - mean
        spread = (core.weights * apart.T) @ apart * (core.df - 2) / core.df
        wide = np.einsum("k,kij->ij", core.weights, core.matrices) + spread
        added = [Component(weight, mean, by**2 * wide) for weight, by in DEFENCE]
        return add_components(core, added)

    @property
    def law_kinds(self) -> NDArray[np.str_]:
        """What each component of the law is for."""
        return np.append(self.kinds, [DEFENSIVE] * len(DEFENCE))

    @property
    def undefended(self) -> Mixture:
        """The law of a draw that is of no defensive component."""
        return self.law.given(self.law_kinds != DEFENSIVE)

    def extended(self, added: Sequence[Component], kind: str) -> Self:
        """Return the proposal with more components of a kind."""
        kinds = np.append(self.kinds, [kind] * len(added))
        return type(self)(add_components(self.undefended, added), kinds)

    def separate(self) -> Labels:
        """Return the maximum of each component of the law; of several that overlap one.

        Defensive components belong to none.
        """
        means, matrices = self.core.means, self.core.matrices
        apart, sums = means[:, None] - means, matrices[:, None] + matrices
        solved = np.linalg.solve(sums, apart[..., None]).squeeze(-1)
        near = np.einsum("ijd,ijd->ij", apart, solved) < MAXIMA_APART
        labels = np.full(len(self.law_kinds), NO_MAXIMUM, dtype=np.intp)
        owned = self.law_kinds != DEFENSIVE
        labels[owned] = connected_components(near, directed=False)[1]
        return labels


def add_components(mixture: Mixture, added: Sequence[Component]) -> Mixture:
    """Return a mixture with more components."""
    weights, means, matrices = map(np.array, zip(*added, strict=True))
    weights = weights * min(1.0, MOST_ADDED / weights.sum())
    return Mixture(
        np.append((1 - weights.sum()) * mixture.weights, weights),
        np.vstack([mixture.means, means]),
        np.concatenate([mixture.matrices, matrices]),
        mixture.df,
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
