"""The public names: those of ``import emcee_femu as ef``, and of its subjects."""

import inspect
import re

import emcee_femu as ef

SUBJECTS = ("moves", "figures", "frf", "population", "paper")


def public_names():
    """Return what users call, by its name after ``ef.``."""
    found = {}
    for prefix in ("", *(f"{subject}." for subject in SUBJECTS)):
        module = getattr(ef, prefix[:-1]) if prefix else ef
        exported = {*re.findall(r"\b(\w+) as \1\b", inspect.getsource(module))}
        for name in sorted({*dir(module), *exported}):
            value = getattr(module, name)
            where = getattr(value, "__module__", "")
            home = module.__name__ if prefix == "paper." else "emcee_femu"
            own = where == module.__name__ or name in exported
            own &= where.startswith(home) and not inspect.ismodule(value)
            if (
                name[0] != "_"
                and callable(value)
                and own
                and value not in found.values()
            ):
                found[prefix + name] = value
    return found
