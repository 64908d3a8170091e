"""What is sampled and how, as text: a run may go on only with what it began with."""

from .sampled import changing as changing
from .sampled import differences as differences
from .sampled import fingerprint as fingerprint
from .sampled import without as without
