"""The ten numbers that steer a run; each other constant serves one function."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """The sizes of a run; CONTRIBUTING.md names a table of what half and twice do.

    Attributes:
        sized_for: Evaluations of the chain for which a search is made if the run ends
            by its verdict. A larger search makes a better proposal, but the chain does
            not gain what it costs.
        least_budget: Solves that a search may take however short the chain is. Before a
            longer chain it may take twice the evaluations of the chain.
        searched_share: Ratio of the points of a search to the evaluations of the chain.
            (1,000 points come before a run of an FE model that ends by its verdict. Of
            80 runs of the targets of stages.py as many had theirs with 2,000.)
        most_searched: Most points of a search. A bare density has as many as its
            chain up to then, since climbs by differences are dear. (38,400 of them took
            a quarter of 250,000 solves for one maximum; 2,000 found a needle in d = 4
            in 4 of 10 searches, 10,000 in 9.)
        untested: Climbs in a row that end at known maxima, after which a point has to
            be parted by a valley from the maximum that it would belong to.
        fruitless: Climbs in a row that end at known maxima, after which a search has
            found what it can find.
        dfs: Degrees of freedom among which the tails of a proposal are chosen.
        bent: Effective share of a mixture's draws below which polynomials of the
            response may do better.
        independence_shares: Pairs of an acceptance of the proposal, and the share of
            independence proposals in the chain from that acceptance on.
        sd_at_end: Relative error that every standard deviation must fall below before a
            run of "auto" may end. It is half of the verdict's limit, since a run that
            is judged repeatedly would otherwise end too early by chance. (With it, one
            run in fifty ends with a standard deviation that is more than 12 % off.)
            Runs by other moves end at the verdict's limit: they know a tail only by
            their chain, so that those which have hardly seen it claim the smallest
            errors, and would be the first to meet a stricter limit.
    """

    sized_for: int = 10_000
    least_budget: int = 30_000
    searched_share: float = 0.1
    most_searched: int = 10_000
    untested: int = 2
    fruitless: int = 4
    dfs: tuple[float, ...] = (3.0, 5.0, 8.0, 16.0, 50.0)
    bent: float = 0.5
    independence_shares: tuple[tuple[float, float], ...] = (
        (0.2, 0.9),
        (0.05, 0.6),
        (0.0, 0.2),
    )
    sd_at_end: float = 0.05

    @property
    def poor_acceptance(self) -> float:
        """Acceptance of the proposal below which other moves do better."""
        (best, _), *_ = self.independence_shares
        return best

    @property
    def sd_known_to(self) -> float:
        """Relative error of a standard deviation that the verdict allows."""
        return 2 * self.sd_at_end


SETTINGS = Settings()
