"""From a modal test to a posterior that can be trusted: pairing, noise, discrepancy.

A two-storey steel frame of one bay stands for the engineer's model. Unknown are the
stiffness factors of the columns, of the beams along x and of those along y. A modal
test with eight accelerometers, repeated ten times, found six modes. The test is
simulated, and honestly so: the floors of the true frame are heavier on one side, so
that no parameters of the model reproduce it exactly.

What the analysis meets, and what answers it:

    ten repeats        Measurements.from_repeats: mean and covariance of one test
    eight sensors      PairedModel: modes are told by their shapes at the sensors
    modes that cross   sway along x and y change their order inside the bounds: the same
    wrong model        FrequencyTerm(discrepancy="model error"): inferred, with a prior
    what is learned    identifiability, pairing_table, predictive_table, plot_predictive

Run it:  python examples/modal_test.py
"""

import argparse
from pathlib import Path

import numpy as np
from scipy import stats

import emcee_femu as ef

STOREYS, HEIGHT, WIDTH_X, WIDTH_Y = 2, 3.5, 6.0, 5.6  # -, m, m, m
TRUTH = {"columns": 0.95, "beams x": 1.15, "beams y": 0.85}
MODES, REPEATS = 6, 10
SCATTER, SENSOR_NOISE = 0.002, 0.02  # of frequencies, and of shapes of length one


def frame(floor_mass: tuple[float, float]) -> ef.FrameModel:
    """Return the frame; ``floor_mass`` is the density of both sides' beams, kg/m3."""
    corners = [(0.0, 0.0), (WIDTH_X, 0.0), (WIDTH_X, WIDTH_Y), (0.0, WIDTH_Y)]
    nodes = [(x, y, HEIGHT * s) for s in range(STOREYS + 1) for x, y in corners]
    # A factor of E scales E A and both E I; the beams carry the floors' mass.
    column = {"A": 9e-3, "Iy": 4e-5, "Iz": 4e-5, "orientation": (1.0, 0.0, 0.0)}
    beam = {"GJ": 4e4, "A": 2e-2, "Iy": 9e-4, "Iz": 1.2e-4}
    light, heavy = floor_mass
    sections = {
        "columns": ef.Section(E="columns", GJ=4e4, rho=7850.0, **column),
        "x light": ef.Section(E="beams x", rho=light, **beam),
        "x heavy": ef.Section(E="beams x", rho=heavy, **beam),
        "y": ef.Section(E="beams y", rho=(light + heavy) / 2, **beam),
    }
    sides = ("x light", "y", "x heavy", "y")
    elements = []
    for foot in range(4 * STOREYS):
        corner, top = foot % 4, foot + 4
        elements.append((foot, top, "columns"))
        elements.append((top, top + 1 if corner < 3 else top - 3, sides[corner]))
    supports = dict.fromkeys(range(4), "all")
    return ef.FrameModel(
        nodes, elements, sections, supports, n_modes=2 * MODES, shapes=True
    )


class StiffnessFactors:
    """The frame in terms of factors of its nominal stiffness, 210 GPa."""

    names, n_modes = tuple(TRUTH), 2 * MODES

    def __init__(self, floor_mass: tuple[float, float]) -> None:
        """Build the frame."""
        self.frame = frame(floor_mass)

    def __call__(self, parameters: dict[str, np.ndarray]) -> ef.ModalSolution:
        """Solve for all walkers at once."""
        return self.frame({name: 210e9 * parameters[name] for name in self.names})


def modal_test(seed: int) -> ef.Measurements:
    """Simulate the test: ten repeats of six modes at eight sensors."""
    rng = np.random.default_rng(seed)
    true = StiffnessFactors(floor_mass=(3.4e4, 4.6e4))
    modes = true({name: np.array([factor]) for name, factor in TRUTH.items()})
    # Two opposite corners of both floors, x and y each.
    labels = [f"{n}:{u}" for n in (4, 6, 8, 10) for u in ("ux", "uy")]
    dofs = [true.frame.dofs.index(label) for label in labels]
    shapes = modes.shapes[0][dofs][:, :MODES]
    shapes = shapes / np.linalg.norm(shapes, axis=0)
    common = rng.normal(size=(REPEATS, 1))  # temperature shifts all modes together
    own = rng.normal(size=(REPEATS, MODES))
    scatter = SCATTER * (0.8 * common + 0.6 * own)
    noise = SENSOR_NOISE * rng.normal(size=(REPEATS, *shapes.shape))
    return ef.Measurements.from_repeats(
        modes.frequencies[0, :MODES] * (1 + scatter),
        shapes + noise,
        sensors=labels,
        dofs=dofs,
    )


def main(
    generations: int = 1_000, ensembles: int = 2, seed: int = 1, out: str = ""
) -> dict:
    """Update the frame, print what was learned, and draw it."""
    test = modal_test(seed)
    print(test)
    model = ef.PairedModel(StiffnessFactors(floor_mass=(4e4, 4e4)), test)
    stiffness = stats.lognorm(0.2)  # 20 % about the nominal
    prior = ef.IndependentPrior(
        {**dict.fromkeys(TRUTH, stiffness), "model error": stats.halfnorm(scale=0.02)}
    )
    terms = [
        ef.FrequencyTerm(test, discrepancy="model error"),
        ef.ShapeTerm(test, delta=SENSOR_NOISE),
    ]
    posterior = ef.LogPosterior(model, terms, prior)
    samplers = ef.run(
        posterior, "auto", 16, generations, ensembles=ensembles, seed=seed
    )
    idata = ef.to_inference_data(samplers, posterior)
    for part in (
        ef.diagnose(samplers),
        ef.parameter_table(idata, nominal=TRUTH),
        ef.identifiability(idata),
        ef.pairing_table(idata),
        ef.predictive_table(idata, posterior),
    ):
        print(f"\n{part}")
    directory = Path(out or Path("figures") / "modal_test")
    directory.mkdir(parents=True, exist_ok=True)
    figure = ef.plot_predictive(idata, posterior)
    figure.savefig(directory / "predicted.png", dpi=150)
    print(f"\nfigure in {directory.resolve()}")
    return {"idata": idata, "test": test}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--generations", type=int, default=1_000)
    parser.add_argument("--ensembles", type=int, default=2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", default="", help="directory of the figure")
    main(**vars(parser.parse_args()))
