"""A training that takes seconds, and ways to interrupt it."""

from cascadenorm.data_gen import DatasetConfig
from cascadenorm.learned.config import Fit, TrainConfig

TINY = TrainConfig(
    faces_per_mesh=500,
    clusters=2,
    fit=Fit(hidden=(16, 8), epochs=15, batch=128),
    data=DatasetConfig(
        count=4,
        families=("smooth",),
        min_faces=1200,
        max_faces=1500,
        noise_kinds=("normal",),
        min_level=0.15,
        max_level=0.3,
    ),
)


class Interrupted(Exception):
    pass


def interrupt_at(task: str, done: int):
    def progress(now: str, count: int, total: int, note: str = "") -> None:
        if now == task and count == done:
            raise Interrupted

    return progress
