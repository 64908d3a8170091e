"""What a modal test gave: arrays, repeated tests, files, identification software."""

from .record import Measurements as Measurements
