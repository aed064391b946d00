"""Training of an edge classifier and an optional objectness head on prepared graphs."""

from sgbd.training.error import TrainingError
from sgbd.training.survey import Survey, survey_graphs
from sgbd.training.trainer import Trainer, TrainingResult

__all__ = ["Survey", "Trainer", "TrainingError", "TrainingResult", "survey_graphs"]
