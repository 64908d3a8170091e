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
from .campaign import Campaign
from .proposal import CARRIER, Component, Proposal, add_components

# Rounds of a refinement at most.
REFINING_ROUNDS = 12
# Effective share of a round's draws that ends the refinement.
GOOD_SHARE = 0.9
# Effective share from which a heavy tail of the weights counts little.
HIGH_SHARE = 0.8
# Pareto k of a tail that is not heavy.
FAIR_K = 0.4
# Gain of the effective share, as a ratio, that two rounds without end the refinement.
GAIN_OF_ROUND = 1.05
# Rounds whose proposals may be good by chance.
FIRST_ROUNDS = 2
# Components of a refined mixture at most.
MOST_REFINED = 30
# Weight of a new component.
NEW_WEIGHT = 0.2
# Share of the draws by which its matrix is known, and ridge of the nearest component.
NEAREST_SHARE = 0.1
NEW_RIDGE = 0.01
# Log-weight below the largest, from which a draw carries no mass.
RELEVANT = 8.0
# Share of the largest weight, below which a draw does not take part in a fit.
LEAST_SHARE = 1e-12
# Iterations of the fit to stressed weights.
STRESSED = 10
# ln(p / q) that a good proposal may leave where a draw has more than the share below.
LACK = 2.5
CARRIES = 1e-5
# The variance of a parameter is known if its ten largest terms hold no more of it than
# this. (Those of a Gaussian hold .06 of the variance of 1,500 draws.)
TERMS = 10
HELD_BY_TERMS = 0.08
# Weight of a component for draws that carry a variance, before it is made heavy.
CARRIER_WEIGHT = 0.02
# ln(p / q) above which such a draw counts: more than a good proposal leaves.
CARRIER_LACK = 0.3
# Ridge of the nearest component in the matrix of that for carriers.
CARRIER_RIDGE = 0.3
# Rounds of these, and their draws by those of a round of the refinement: they are of
# the new components alone, which are little of a mixture.
CARRYING_ROUNDS = 4
CARRYING_SHARE = 1 / 3


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
            lack = archive.log_ratio(c.proposal.law)
            if lack[archive.shares > CARRIES].max() < LACK:
                break
        if number + 1 < REFINING_ROUNDS:
            core = _refit(archive, c.proposal.core, c.settings.dfs)
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
        c.extend(carriers, CARRIER, round(CARRYING_SHARE * c.sizes.batch))


def judge(campaign: Campaign) -> None:
    """Judge the proposal by fresh draws of it."""
    c = campaign
    c.draft = Draft(c.proposal, *c.draw(c.proposal.law, c.sizes.judged))


def _is_enough(drafts: list[Draft]) -> bool:
    """Return whether a proposal is as good as can be.

    Or two rounds were without a gain, and there is no heavy tail that counts.
    """
    shares = [draft.efficiency for draft in drafts]
    if shares[-1] > GOOD_SHARE:
        return True
    if len(drafts) <= FIRST_ROUNDS + 1:
        return False
    settled = max(shares[-2:]) < GAIN_OF_ROUND * max(shares[:-2])
    return settled and (drafts[-1].pareto_k < FAIR_K or shares[-1] > HIGH_SHARE)


def _carriers(archive: Archive, law: Mixture) -> Iterator[tuple[Floats, Floats]]:
    """Yield mean and matrix of draws that carry the variance of a parameter."""
    x = archive.x
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
        nearest = np.argmin(law.squared_distances(mean[None])[0])
        centred = x - mean
        matrix = (part * centred.T) @ centred
        matrix += CARRIER_RIDGE * law.matrices[nearest]
        yield mean, matrix


def _refit(archive: Archive, core: Mixture, dfs: tuple[float, ...]) -> Mixture:
    """Return the mixture that fits the weighted draws best, by Akaike's criterion."""
    shares = archive.shares
    # Truncated, so that one draw where the mixture lacks mass does not outweigh all
    # others (Ionides 2008, doi:10.1198/106186008X320456).
    shares = np.minimum(shares, len(shares) ** -0.5)
    shares /= shares.sum()
    use = shares > LEAST_SHARE * shares.max()
    x, shares = archive.x[use], shares[use]
    size, d = 1.0 / np.sum(shares**2), x.shape[1]
    candidates = []
    for df in dfs:
        other = replace(core, df=df)
        candidates.append((-2 * size * float(shares @ other.log_density(x)), other))
    for fitted, gained in _fits(x, shares, archive.log_p[use], core):
        parameters = len(fitted.weights) * (1 + d + d * (d + 1) / 2)
        candidates.append((2 * parameters - 2 * size * gained, fitted))
    chosen = min(candidates, key=lambda pair: pair[0])[1]

    def share(fitted: Mixture) -> float:
        return archive.effective_share(Proposal.fitted(fitted).law)

    tails = [replace(chosen, df=df) for df in dfs]
    # In many dimensions a fit looks better by its own draws than it is.
    if chosen.means is core.means and max(map(share, tails)) > HIGH_SHARE:
        return max(tails, key=share)
    # By the effective share, which regions of large weights spoil most: EM on weights
    # that stress them brings the mixture nearer to its largest effective share.
    excess = archive.log_p[use] - chosen.log_density(x)
    stressed = shares * np.exp(0.5 * (excess - excess.max()))
    again = chosen.improve(x, stressed / stressed.sum(), STRESSED)[0]
    tails += [replace(again, df=df) for df in dfs]
    return max(tails, key=share)


def _fits(
    x: Floats, shares: Floats, log_p: Floats, core: Mixture
) -> Iterator[tuple[Mixture, float]]:
    """Yield the fit, and one with a component more where the mixture lacks most."""
    fitted, gained = core.improve(x, shares)
    yield fitted, gained
    if len(fitted.weights) >= MOST_REFINED:
        return
    relevant = np.log(shares / shares.max()) > -RELEVANT
    lacking = np.where(relevant, log_p - fitted.log_density(x), -np.inf)
    place = x[np.argmax(lacking)]
    nearest = np.argmin(fitted.squared_distances(place[None])[0])
    near = fitted.matrices[nearest]
    distances = ((x - place) @ np.linalg.inv(fitted.factors[nearest]).T) ** 2
    order = np.argsort(distances.sum(axis=1))
    enough = np.searchsorted(np.cumsum(shares[order]), NEAREST_SHARE)
    some = order[: max(int(enough), 3 * x.shape[1])]
    share = 0.5 * shares[some] / shares[some].sum() + 0.5 / len(some)
    centred = x[some] - place
    matrix = (share * centred.T) @ centred + NEW_RIDGE * near
    new = add_components(fitted, [Component(NEW_WEIGHT, place, matrix)])
    yield new.improve(x, shares)
