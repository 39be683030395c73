"""Recipes of few updates, for tests that are not about accuracy."""

from dataclasses import replace

import pytest

from eskin.training import recipe


def few_updates(patch: pytest.MonkeyPatch, updates: int) -> None:
    """At most so many updates until ``patch`` is undone."""
    few = {
        name: replace(recipe_, updates=min(recipe_.updates, updates))
        for name, recipe_ in recipe.RECIPES.items()
    }
    patch.setattr(recipe, "RECIPES", few)
