"""Recipes of few updates, for what is not about accuracy."""

from dataclasses import replace

import pytest

from eskin.training import recipe


def few_updates(patch: pytest.MonkeyPatch, updates: int) -> None:
    """At most so many updates until ``patch`` is undone."""
    few = {name: replace(one, updates=min(one.updates, updates)) for name, one in recipe.RECIPES.items()}
    patch.setattr(recipe, "RECIPES", few)
