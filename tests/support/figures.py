"""What every figure must be: nothing clipped, nothing on top of another."""

from matplotlib.figure import Figure
from matplotlib.text import Text


def visible_texts(figure):
    hidden = set()
    for axes in figure.axes:
        if not axes.get_visible():
            hidden.update(axes.findobj(Text))
        for axis in (axes.xaxis, axes.yaxis):
            low, high = sorted(axis.get_view_interval())
            for tick in [*axis.get_major_ticks(), *axis.get_minor_ticks()]:
                if not low <= tick.get_loc() <= high or not axis.get_visible():
                    hidden.update(tick.findobj(Text))
    return [
        text
        for text in figure.findobj(Text)
        if text.get_visible() and text.get_text() and text not in hidden
    ]


def assert_nothing_is_clipped(figure, *expected):
    """Check that every text lies on the canvas, up to 1 px, and the expected occur."""
    assert type(figure) is Figure
    figure.canvas.draw()  # once, as savefig does
    texts = visible_texts(figure)
    width, height = figure.canvas.get_width_height()
    for text in texts:
        box = text.get_window_extent()
        inside = box.x0 >= -1 and box.y0 >= -1 and box.x1 <= width + 1
        assert inside and box.y1 <= height + 1, (text.get_text(), box)
    assert set(expected) <= {text.get_text() for text in texts}


def assert_no_texts_overlap(figure):
    figure.canvas.draw()
    boxes = [(t.get_text(), t.get_window_extent()) for t in visible_texts(figure)]
    for i, (text, box) in enumerate(boxes):
        for other, there in boxes[:i]:
            assert not box.overlaps(there), (text, other)


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]
