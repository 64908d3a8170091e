"""The picture of the front page: a mode that swings, before and after updating.

It runs the tutorial on a modal test, and draws its torsional mode as an animated SVG.
The measured mode swings at the measured frequency, the model at its own: before
updating it runs out of step with the measurement, and afterwards it stays with it.
Colours follow the reader's light or dark theme.

Run it:  python examples/front_picture.py  (writes .github/images/front.svg)
"""

import runpy
from pathlib import Path

import matplotlib

matplotlib.use("Agg")  # the tutorial draws figures

import numpy as np

import emcee_femu as ef
from emcee_femu.figures.mode_shapes import _bend, _choose_view, _displace
from emcee_femu.posterior.priors import prior_centre
from emcee_femu.results.shapes import solve_shapes

ROOT = Path(__file__).parents[1]
MODE = 2  # from 0: torsion. (The sway modes are close: their shapes mix.)
SECONDS = 1.6  # of a measured period on the screen
WIDTH, HEIGHT, TOP = 240, 236, 50  # of a panel, and of its title, in units of the SVG
AMPLITUDE = 0.13  # of the size of the structure
SMOOTH = ' calcMode="spline" keyTimes="0;.5;1" keySplines=".37 0 .63 1;.37 0 .63 1"'
STYLE = """
text { font-family: system-ui, "Segoe UI", Helvetica, Arial, sans-serif; 
  font-size: 15px; text-anchor: middle; fill: #1c2126; }
.soft { fill: #5a636c; font-size: 13px; } .rest { stroke: #b8c0c7; stroke-width: 1.2; }
.model { stroke: #1f5fa8; stroke-width: 2.4; } .sensor { fill: #c8102e; }
.test { fill: #c8102e; font-size: 13px; }
path { fill: none; stroke-linecap: round; stroke-linejoin: round; }
@media (prefers-color-scheme: dark) {
  text { fill: #e6e9ec; } .soft { fill: #a3adb6; } .rest { stroke: #4d565e; }
  .model { stroke: #6aa9f0; } .sensor, .test { fill: #ff6b7f; }
}
"""


def swing(attribute, ends, seconds):
    """Return an attribute that swings between two values as a cosine does."""
    values = ";".join([*ends, ends[0]])
    return (
        f'<animate attributeName="{attribute}" dur="{seconds:.3f}s" values="{values}" '
        f'repeatCount="indefinite"{SMOOTH}/>'
    )


def path(lines):
    """Return the path of lines, ``(k, 2)`` each."""
    return "".join(
        "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in line) for line in lines
    )


def draw_panel(solved, geometry, title, left):
    """Return the marks of one panel, and the frequency of the model's mode."""
    moves, _, measured, turns = _displace(solved, geometry, MODE)
    pairing = solved.pairing
    hertz = float(solved.frequencies[pairing.chosen[MODE]])
    nodes = np.array([*geometry.nodes.values()])
    view = _choose_view(nodes, [*moves.values()])
    flat = nodes @ view.T
    size = np.linalg.norm(np.ptp(flat, axis=0))
    factor = AMPLITUDE * size / max(map(np.linalg.norm, moves.values()))
    factor *= np.sign(measured[max(measured)].sum())  # both panels begin alike
    scale = 0.72 * WIDTH / np.ptp(flat, axis=0)[0]
    middle = flat.mean(axis=0)

    def place(points):
        x, y = ((points @ view.T - middle) * scale).T
        return np.column_stack([left + WIDTH / 2 + x, TOP + HEIGHT / 2 - y])

    bent = [_bend(geometry, line, moves, turns) for line in geometry.lines]
    still = path(place(points) for points, _ in bent)
    ends = [
        path(place(points + sign * factor * move) for points, move in bent)
        for sign in (1, -1)
    ]
    own = SECONDS * pairing.hertz[MODE] / hertz
    x = left + WIDTH / 2
    marks = [
        f'<text x="{x}" y="22">{title}</text>',
        f'<text class="soft" x="{x}" y="42">model: {hertz:.2f} Hz</text>',
        f'<path class="rest" d="{still}"/>',
        f'<path class="model" d="{ends[0]}">{swing("d", ends, own)}</path>',
    ]
    for node, move in measured.items():
        points = np.array([geometry.nodes[node] + s * factor * move for s in (1, -1)])
        (x, y), (to_x, to_y) = place(points)
        both = [("cx", x, to_x), ("cy", y, to_y)]
        inside = "".join(
            swing(name, [f"{a:.1f}", f"{b:.1f}"], SECONDS) for name, a, b in both
        )
        start = f'class="sensor" cx="{x:.1f}" cy="{y:.1f}" r="4.5"'
        marks.append(f"<circle {start}>{inside}</circle>")
    return marks, hertz


def main(output=ROOT / ".github" / "images" / "front.svg"):
    """Run the tutorial, and draw the mode before and after updating."""
    page = runpy.run_path(str(ROOT / "examples" / "tutorials" / "modal_test.py"))
    posterior, draws = page["posterior"], page["idata"]["posterior"]
    mean = [float(draws[name].mean()) for name in posterior.names]
    states = {"before updating": prior_centre(posterior.prior), "after updating": mean}
    (test,) = posterior.experiments
    marks, found = [], {}
    for number, (title, theta) in enumerate(states.items()):
        solved = solve_shapes(posterior, test, np.array(theta))
        drawn, found[title] = draw_panel(
            solved, test.model.model.geometry, title, number * WIDTH
        )
        marks += drawn
    measured = solved.pairing.hertz[MODE]
    foot = TOP + HEIGHT + 24
    marks.append(
        f'<text class="test" x="{WIDTH}" y="{foot}">measured by eight sensors: '
        f"{measured:.2f} Hz</text>"
    )
    words = "A mode of a frame, measured and of the model, before and after updating"
    box = f'viewBox="0 0 {2 * WIDTH} {foot + 14}" role="img"'
    output.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" {box}><title>{words}</title>'
        f"<style>{STYLE}</style>" + "\n".join(marks) + "</svg>\n",
        encoding="utf-8",
    )
    errors = [
        ef.frequency_table(page["idata"]).column(title)[-1]
        for title in ("error %", "error % ")
    ]
    print(
        f"Mode {MODE + 1}:",
        {k: round(f, 3) for k, f in found.items()},
        "measured",
        measured,
    )
    print(
        "Mean error of the frequencies: {:.1f} % before, {:.1f} % after".format(*errors)
    )
    print(f"Written to {output}")


if __name__ == "__main__":
    main()
