"""Adaptive importance sampling: a proposal refined by the weights of its own draws.

Three stages: ``adapt`` refines the core, ``carry`` adds components where few draws
carry the variance of a parameter, and ``judge`` draws anew to judge the proposal.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..contracts import Floats
from ..moves.mixture import Mixture
from .archive import Archive, Draft
from .campaign import POOR_ACCEPTANCE, Campaign
from .proposal import CARRIER, Component, Proposal, add_components

# Rounds of a refinement at most.
REFINING_ROUNDS = 12
# Effective share of a round's draws that ends the refinement.
GOOD_SHARE = 0.9
# Gain of the effective share, as a ratio, that two rounds without end the refinement.
GAIN_OF_ROUND = 1.05
# Weight of a new component.
NEW_WEIGHT = 0.2
# The variance of a parameter is known if its ten largest terms hold no more of it than
# this. (Those of a Gaussian hold .06 of the variance of 1,500 draws.)
TERMS = 10
HELD_BY_TERMS = 0.08
# Weight of a component for draws that carry a variance, before it is made heavy.
CARRIER_WEIGHT = 0.02
# ln(p / q) above which such a draw counts: more than a good proposal leaves.
CARRIER_LACK = 0.3
# Rounds of these.
CARRYING_ROUNDS = 4


def adapt(campaign: Campaign) -> None:
    """Refine the core of the proposal in rounds of drawing, weighting and fitting."""
    c, archive, drafts = campaign, campaign.archive, list[Draft]()
    for number in range(REFINING_ROUNDS):
        size = c.sizes.batch * max(2, number) // 2  # later rounds have more draws
        draft = Draft(c.proposal, *c.draw(c.proposal.law, size))
        archive.add(draft.theta, draft.rows, c.proposal.law)
        drafts.append(draft)
        spent = sum(len(past.theta) for past in drafts)
        if not len(archive.x) or spent >= c.sizes.refined:
            break
        if _is_enough(drafts):
            break
        if number + 1 < REFINING_ROUNDS:
            core = _refit(c, draft.acceptance < POOR_ACCEPTANCE)
            c.proposal = Proposal.fitted(core)
    if np.isnan(c.first_share):
        c.first_share = archive.effective_share(c.proposal.law)


def carry(campaign: Campaign) -> None:
    """Add components where few draws carry the variance of a parameter."""
    c = campaign
    for _ in range(CARRYING_ROUNDS):
        places = _carriers(c.archive, c.proposal.law)
        weight = c.heavy * CARRIER_WEIGHT
        carriers = [Component(weight, *place) for place in places]
        if not carriers:
            break
        # They are of the new components alone, which are little of a mixture.
        c.extend(carriers, CARRIER, c.sizes.batch // 3)


def judge(campaign: Campaign) -> None:
    """Judge the proposal by fresh draws of it."""
    c = campaign
    c.draft = Draft(c.proposal, *c.draw(c.proposal.law, c.sizes.judged))


def _is_enough(drafts: list[Draft]) -> bool:
    """Return whether a proposal is as good as can be.

    Or two rounds were without a gain, it is not poor, and its weights are reliable.
    """
    shares = [draft.efficiency for draft in drafts]
    if shares[-1] > GOOD_SHARE:
        return True
    earlier = shares[:-2]  # the first may be good by chance
    settled = len(earlier) > 1 and max(shares[-2:]) < GAIN_OF_ROUND * max(earlier)
    last = drafts[-1]
    return settled and last.reliable and last.acceptance > POOR_ACCEPTANCE


def _carriers(archive: Archive, law: Mixture) -> Iterator[tuple[Floats, Floats]]:
    """Yield mean and matrix of draws that carry the variance of a parameter."""
    x, plain = archive.x, law.seen_in(None)
    if len(x) <= TERMS:
        return
    lack = archive.log_ratio(law)
    for terms in archive.influence.T:
        held = np.partition(terms, -TERMS)[-TERMS:].sum()
        if held <= HELD_BY_TERMS * terms.sum():  # of one draw with all mass, both 0
            continue
        part = np.where(lack > CARRIER_LACK, terms, 0.0)
        if not part.sum() > 0:
            continue
        part /= part.sum()
        mean = part @ x
        nearest = np.argmin(plain.squared_distances(mean[None])[0])
        centred = x - mean
        matrix = (part * centred.T) @ centred
        matrix += plain.matrices[nearest]
        yield mean, matrix


def _refit(campaign: Campaign, poor: bool) -> Mixture:
    """Return the old mixture or a fit to the weighted draws, by Akaike's criterion.

    In each of the coordinates there are two fits, one with a component more, at the
    draw that costs the other one most. The tails are those of the largest effective
    share. A poor mixture is not kept: few draws weigh, and none would be enough.
    """
    archive, dfs = campaign.archive, campaign.settings.dfs
    core = campaign.proposal.core
    # Truncated, so that one draw where the mixture lacks mass does not outweigh all
    # others (Ionides 2008, doi:10.1198/106186008X320456).
    shares = np.minimum(archive.shares, len(archive.x) ** -0.5)
    use = shares > np.finfo(float).eps * shares.max()
    x, shares = archive.x[use], shares[use] / shares[use].sum()
    candidates = [] if poor else [replace(core, df=df) for df in dfs]
    for logs in campaign.coordinates:
        begin = core if logs is core.logs else core.seen_in(logs)
        fitted, _ = begin.improve(x, shares)
        costs = np.log(shares) + archive.log_p[use] - fitted.log_density(x)
        place = x[[np.argmax(costs)]]
        nearest = np.argmin(fitted.squared_distances(place)[0])
        (mean,) = fitted.coordinates(place)
        added = Component(NEW_WEIGHT, mean, fitted.matrices[nearest])
        larger, _ = add_components(fitted, [added]).improve(x, shares)
        candidates += [fitted, larger]
    size, d = 1.0 / np.sum(shares**2), x.shape[1]

    def gain(mixture: Mixture) -> float:
        """Return half of Akaike's criterion, with its sign turned."""
        parameters = len(mixture.weights) * (d + 1) * (d + 2) / 2
        free = 0.0 if mixture.means is core.means else parameters
        return float(size * (shares @ mixture.log_density(x)) - free)

    chosen = max(candidates, key=gain)
    return max(
        (replace(chosen, df=df) for df in dfs),
        key=lambda mixture: archive.effective_share(Proposal.fitted(mixture).law),
    )
