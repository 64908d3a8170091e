"""Adaptive importance sampling: a proposal refined by the weights of its own draws.

Three stages: ``adapt`` refines the core, ``carry`` adds components where few draws
carry the variance of a parameter, and ``judge`` draws anew to judge the proposal.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..contracts import Floats
from ..moves.mixture import Mixture
from .archive import Archive, JudgedProposal
from .campaign import Campaign
from .climbing import Maximum
from .maxima import NEGLIGIBLE, WORTH_SOLVES
from .proposal import CARRIER, Component, Proposal, add_components

# Most rounds of a refinement.
REFINING_ROUNDS = 12
# Length of a chain that ends by its verdict, if its proposal is perfect: so many times
# the solves of the smallest round of draws, which is 1,200 solves in most runs.
PERFECT_CHAIN = 4.0
# A round that does not raise the effective share by this factor brings no gain.
GAIN_OF_ROUND = 1.05
# After such a round, another one must cost less than this part of what a perfect
# proposal would still save. (With all of it, the frame of default_runs.py takes 9,200
# solves instead of 8,300, but by seeds 7001 to 7008 8,500 instead of 8,400. With half
# of it after rounds that gain, too, two bent ridges of twelve take 2.5 and 4 times as
# many.)
WITHOUT_GAIN = 0.5
# If its effective share is above this, a mixture whose components are kept needs no fit
# that stresses the largest weights.
HIGH_SHARE = 0.8
# Weight of a new component.
NEW_WEIGHT = 0.2
# The variance of a parameter is known if its ten largest terms hold no more of it than
# this. (Those of a Gaussian hold .06 of the variance of 1,500 draws.)
TERMS = 10
HELD_BY_TERMS = 0.08
# Weight of a component for draws that carry a variance, before it is increased.
CARRIER_WEIGHT = 0.02
# ln(p / q) above which such a draw counts: a good proposal leaves less. (If all above 0
# count, those of the core draw a carrier away from an arm.)
CARRIER_LACK = 0.3
# Most rounds of adding carriers.
CARRYING_ROUNDS = 4


def adapt(campaign: Campaign) -> None:
    """Refine the core of the proposal in rounds of drawing, weighting and fitting."""
    c, archive, rounds = campaign, campaign.archive, list[JudgedProposal]()
    most, restored = c.evaluator.solves + c.sizes.refined, list[Maximum]()
    for number in range(REFINING_ROUNDS):
        # Later rounds have more draws.
        size, further = (c.sizes.batch * max(2, n) // 2 for n in (number, number + 1))
        judged = JudgedProposal(c.proposal, *c.draw(c.proposal.law, size))
        archive.add(judged.theta, judged.rows, c.proposal.law)
        rounds.append(judged)
        if not len(archive.x):
            break
        enough = c.evaluator.solves >= most or _is_enough(c, rounds, further)
        lost = _find_lost(c, restored) if enough else []
        if enough and not lost:
            break
        if number + 1 < REFINING_ROUNDS:
            core = _refit(c, judged.acceptance < c.settings.poor_acceptance)
            if lost:  # and grant as many solves again
                core = add_components(core, [_at_maximum(core, top) for top in lost])
                rounds, restored = [], restored + lost
                most = c.evaluator.solves + c.sizes.refined
            c.proposal = Proposal.fitted(core)
    if np.isnan(c.first_share):
        c.first_share = archive.effective_share(c.proposal.law)


def _find_lost(campaign: Campaign, restored: Sequence[Maximum]) -> list[Maximum]:
    """Return maxima that the proposal never reaches, if not restored before."""
    c, law, maxima = campaign, campaign.proposal.law, campaign.maxima
    return [
        top
        for top in maxima.found
        if top.log_evidence > maxima.log_evidence + np.log(WORTH_SOLVES)
        and top.log_posterior - c.archive.log_evidence
        > NEGLIGIBLE + law.log_density(top.theta[None])[0]
        and not any(top is other for other in restored)
    ]


def _at_maximum(core: Mixture, top: Maximum) -> Component:
    """Return a component at a maximum, no wider than the one nearest to it."""
    alone = Mixture(np.ones(1), top.theta[None], top.covariance[None], core.df)
    alone = alone.seen_in(core.logs)
    near = core.matrices[np.argmin(core.squared_distances(top.theta[None])[0])]
    matrix = min(near, alone.matrices[0], key=np.linalg.det)
    return Component(NEW_WEIGHT, alone.means[0], matrix)


def carry(campaign: Campaign) -> None:
    """Add components where few draws carry the variance of a parameter."""
    c = campaign
    for _ in range(CARRYING_ROUNDS):
        places = _carriers(c.archive, c.proposal.law)
        weight = c.heavy * CARRIER_WEIGHT
        carriers = [Component(weight, *place) for place in places]
        if not carriers:
            break
        # The draws come from the new components alone, whose weight is small.
        c.extend(carriers, CARRIER, c.sizes.batch // 3)


def judge(campaign: Campaign) -> None:
    """Judge the proposal by fresh draws from it."""
    c = campaign
    c.best = JudgedProposal(c.proposal, *c.draw(c.proposal.law, c.sizes.judged))


def _is_enough(
    campaign: Campaign, rounds: Sequence[JudgedProposal], further: int
) -> bool:
    """Return whether the refinement should end before a round of so many more draws.

    A walker waits about 2 / e - 1 steps on average, if e is the effective share: a
    perfect proposal saves 2 / e - 2 chains of its own. The refinement ends if a round
    costs more than that, or than a part of it if the last one brought no gain. It also
    ends if two brought none to a proposal so poor that polynomials will do better.

    A chain whose number of steps is given is worth e / (2 - e) times as many steps of a
    perfect proposal. If it is longer than chains that end by their verdict, its
    refinement ends by the price, or after two rounds without gain.
    """
    c, shares = campaign, [judged.efficiency for judged in rounds]
    last, earlier = shares[-1], shares[:-2]  # the first may be good by chance
    gained = last > GAIN_OF_ROUND * max(shares[:-1], default=0.0)
    settled = len(earlier) > 1 and max(shares[-2:]) < GAIN_OF_ROUND * max(earlier)
    if c.sizes.chain > c.settings.sized_for:
        chain = c.sizes.chain * last / (2 - last)
    else:
        chain = PERFECT_CHAIN * c.sizes.batch * (1.0 if gained else WITHOUT_GAIN)
        settled = settled and c.bendable and last < c.settings.bent
    return settled or chain * (2 - 2 * last) < further * last  # times e: it may be zero


def _carriers(archive: Archive, law: Mixture) -> Iterator[tuple[Floats, Floats]]:
    """Yield mean and matrix of draws that carry the variance of a parameter."""
    x, plain = archive.x, law.seen_in(None)
    if len(x) <= TERMS:
        return
    lack = archive.log_ratio(law)
    for terms in archive.influence.T:
        held = np.partition(terms, -TERMS)[-TERMS:].sum()
        if held <= HELD_BY_TERMS * terms.sum():  # both are 0 if one draw has all mass
            continue
        part = np.where(lack > CARRIER_LACK, terms, 0.0)
        if not part.sum() > 0:
            continue
        part /= part.sum()
        mean = part @ x
        nearest = np.argmin(plain.squared_distances(mean[None])[0])
        centred = x - mean
        matrix = (part * centred.T) @ centred
        # That of the nearest component counts like one of the effective draws.
        matrix += part @ part * plain.matrices[nearest]
        yield mean, matrix


def _refit(campaign: Campaign, poor: bool) -> Mixture:
    """Return the old mixture or a fit to the weighted draws, by Akaike's criterion.

    There are two fits in each of the coordinates. The second one has one component
    more, at the draw that the first fits worst. The degrees of freedom are those of the
    largest effective share. A poor mixture is never kept: only few of its draws have
    weight, and they cannot justify a component by the criterion.
    """
    archive, dfs = campaign.archive, campaign.settings.dfs
    core = campaign.proposal.core
    # Weights are truncated, so that one draw where the mixture lacks mass does not
    # outweigh all others (Ionides 2008, doi:10.1198/106186008X320456).
    shares = np.minimum(archive.shares, len(archive.x) ** -0.5)
    use = shares > np.finfo(float).eps * shares.max()
    x, shares = archive.x[use], shares[use] / shares[use].sum()
    candidates = [] if poor else [replace(core, df=df) for df in dfs]
    for logs in campaign.coordinates:
        begin = core if logs is core.logs else core.seen_in(logs)
        fitted, _ = begin.improve(x, shares)
        costs = np.log(shares) + archive.log_p[use] - fitted.log_density(x)
        added = _component_at(int(np.argmax(costs)), x, shares, fitted)
        larger, _ = add_components(fitted, [added]).improve(x, shares)
        candidates += [fitted, larger]
    size, d = 1.0 / np.sum(shares**2), x.shape[1]

    def gain(mixture: Mixture) -> float:
        """Return half of Akaike's criterion, with its sign turned."""
        parameters = len(mixture.weights) * (d + 1) * (d + 2) / 2
        free = 0.0 if mixture.means is core.means else parameters
        return float(size * (shares @ mixture.log_density(x)) - free)

    def share(mixture: Mixture) -> float:
        return archive.effective_share(Proposal.fitted(mixture).law)

    chosen = max(candidates, key=gain)
    best = max((replace(chosen, df=df) for df in dfs), key=share)
    # In many dimensions a fit looks better by its own draws than it is.
    if chosen.means is core.means and share(best) > HIGH_SHARE:
        return best
    # The largest weights lower the effective share most. EM on weights that stress them
    # brings the mixture closer to its largest effective share.
    excess = archive.log_p[use] - chosen.log_density(x)
    stressed = shares * np.exp(0.5 * (excess - excess.max()))
    again, _ = chosen.improve(x, stressed / stressed.sum(), 10)
    return max([best, *(replace(again, df=df) for df in dfs)], key=share)


def _component_at(place: int, x: Floats, shares: Floats, fitted: Mixture) -> Component:
    """Return a new component of a mixture, about one of the weighted draws.

    Its matrix is the covariance of the nearest draws, which hold as much as its weight,
    and that of the nearest component, which counts like one draw.
    """
    seen, d = fitted.coordinates(x), x.shape[1]
    centred = seen - seen[place]
    nearest = np.argmin(fitted.squared_distances(x[[place]])[0])
    distances = ((centred @ fitted.inverses[nearest].T) ** 2).sum(axis=1)
    order = np.argsort(distances)
    enough = int(np.searchsorted(np.cumsum(shares[order]), NEW_WEIGHT))
    some = order[: max(enough, 3 * d)]
    # Half of it follows their weights, the rest is equal: one weight may be nearly all.
    part = 0.5 * shares[some] / shares[some].sum() + 0.5 / len(some)
    matrix = (part * centred[some].T) @ centred[some]
    matrix += fitted.matrices[nearest] / len(some)
    return Component(NEW_WEIGHT, seen[place], matrix)
