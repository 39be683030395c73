"""Recipes of few updates, for tests that are not about accuracy."""

from dataclasses import replace

import pytest

from eskin.teach import enrol
from eskin.training import recipe


def few_updates(patch: pytest.MonkeyPatch, updates: int) -> None:
    """At most so many updates, of an enrolment too, until ``patch`` is undone."""
    few = {
        name: replace(recipe_, updates=min(recipe_.updates, updates))
        for name, recipe_ in recipe.RECIPES.items()
    }
    patch.setattr(recipe, "RECIPES", few)
    for known, setting in enrol.SETTINGS.items():
        patch.setitem(enrol.SETTINGS, known, replace(setting, updates=min(setting.updates, updates)))
