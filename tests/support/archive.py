"""Moves that remember: DE-MC by an archive of past states, with and without a state."""

import emcee
import numpy as np

import emcee_femu as ef


class Forgetful(emcee.moves.Move):
    """DE-MCz: differences of states of an archive (doi:10.1007/s11222-008-9104-9).

    Every ``every`` generations where the walkers are joins the archive.
    """

    def __init__(self, every=3):
        self.every, self.archive, self.generation = every, [], 0

    def propose(self, model, state):
        n, ndim = state.coords.shape
        self.archive = self.archive or state.coords.tolist()
        past = np.array(self.archive)
        first = model.random.randint(len(past), size=n)
        second = (first + model.random.randint(1, len(past), size=n)) % len(past)
        steps = 2.38 / np.sqrt(2 * ndim) * (past[first] - past[second])
        steps += 1e-3 * model.random.standard_normal((n, ndim))
        proposed = state.coords + steps
        log_prob, blobs = model.compute_log_prob_fn(proposed)
        accepted = log_prob - state.log_prob > np.log(model.random.random_sample(n))
        new = emcee.State(proposed, log_prob=log_prob, blobs=blobs)
        state = self.update(state, new, accepted)
        self.generation += 1
        if self.generation % self.every == 0:
            self.archive += state.coords.tolist()
        return state, accepted


class ArchiveMove(Forgetful):
    """The same, which says what must be kept."""

    def state(self):
        return {"archive": self.archive, "generation": self.generation}

    def restore(self, state):
        self.archive, self.generation = state["archive"], state["generation"]


class Impatient(emcee.moves.MHMove):
    """Proposes as it ever did, and after some calls refuses all: a wrong factor."""

    def __init__(self):
        super().__init__(self.step)
        self.calls = 0

    def step(self, coords, rng):
        self.calls += 1
        proposed = coords + 0.1 * rng.standard_normal(coords.shape)
        return proposed, np.full(len(coords), -1e9 * (self.calls > 6))


class GuidedByThePast(ef.DEMCMove):
    """A move of this kind that others can take inside: guides of earlier calls."""

    def __init__(self, *arguments, **options):
        super().__init__(*arguments, **options)
        self.past = []

    def get_proposal(self, sample, complement, rng):
        self.past = [*self.past, *np.concatenate(complement).tolist()][-60:]
        return super().get_proposal(sample, [np.array(self.past)], rng)


class GuidedByWhatIsKept(GuidedByThePast):
    def state(self):
        return self.past

    def restore(self, state):
        self.past = state
