"""A proposal: a mixture whose components are known by what they are for."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..contracts import Floats
from ..moves.mixture import Mixture

Labels: TypeAlias = NDArray[np.intp]

# What a component is for.
CORE = "core"
DEFENSIVE = "defensive"
TAIL = "tail"
CARRIER = "carrier"

# Weight of the defensive component, and its width by that of the core. It bounds the
# importance weights where the others leave gaps, and in the tails (Hesterberg 1995,
# doi:10.1080/00401706.1995.10484303).
DEFENCE_WEIGHT = 0.1
DEFENCE_WIDTH = 2.0
# Weight of all components that are added at once.
MOST_ADDED = 0.35
# A valley separates two maxima if the log-density in it is so much below that of the
# lower of the two centres. (Two equal Gaussians have such a valley from 4.6 standard
# deviations apart.)
VALLEY_DEPTH = 2.0
# The density is compared at these fractions of the way between two centres.
WAY = np.linspace(0.0, 1.0, 11)
# The maximum of the defensive component, which belongs to none.
NO_MAXIMUM = -1


class Component(NamedTuple):
    """A component to be added: weight, mean ``(d,)``, scale matrix ``(d, d)``.

    In the coordinates of the mixture to which it is added.
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
        """The mixture from which is drawn, with the defensive component."""
        core = self.core
        mean = core.weights @ core.means
        apart = core.means - mean
        spread = (core.weights * apart.T) @ apart * (core.df - 2) / core.df
        wide = np.einsum("k,kij->ij", core.weights, core.matrices) + spread
        defence = Component(DEFENCE_WEIGHT, mean, DEFENCE_WIDTH**2 * wide)
        return add_components(core, [defence])

    @property
    def law_kinds(self) -> NDArray[np.str_]:
        """What each component of the law is for."""
        return np.append(self.kinds, DEFENSIVE)

    @property
    def undefended(self) -> Mixture:
        """The law of a draw that is not of the defensive component."""
        return self.law.given(self.law_kinds != DEFENSIVE)

    def extended(self, added: Sequence[Component], kind: str) -> Self:
        """Return the proposal with more components of a kind."""
        kinds = np.append(self.kinds, [kind] * len(added))
        return type(self)(add_components(self.undefended, added), kinds)

    def separate(self) -> Labels:
        """Return the maximum of each component of the law.

        Two components belong to one maximum if the density of the mixture has no deep
        valley between their centres, or between either and others of that maximum. The
        defensive component belongs to none.
        """
        core = self.undefended
        apart = core.means[:, None] - core.means
        ways = core.means + WAY[:, None, None, None] * apart
        heights = core.log_density_of_coordinates(ways.reshape(-1, core.means.shape[1]))
        passes = heights.reshape(ways.shape[:3]).min(axis=0)
        tops, labels = np.diagonal(passes), np.arange(len(passes))
        pairs = np.column_stack(np.unravel_index(passes.argsort(None), passes.shape))
        for i, j in pairs[::-1]:  # the highest pass first
            lower, higher = sorted((labels[i], labels[j]), key=lambda k: tops[k])
            if passes[i, j] > tops[lower] - VALLEY_DEPTH:
                labels[labels == lower] = higher
        all_labels = np.full(len(self.law_kinds), NO_MAXIMUM, dtype=np.intp)
        owned = self.law_kinds != DEFENSIVE
        all_labels[owned] = np.unique(labels, return_inverse=True)[1]
        return all_labels


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
