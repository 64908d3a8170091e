"""The colours that figures share: red is what counts, blue what it is compared with."""

RED, BLUE, GREY = "#c8102e", "#1f5fa8", "0.45"
