"""Recipes of few updates, for what is not about accuracy."""

import dataclasses

import pytest

from eskin.training import recipe as recipes


@pytest.fixture
def quick(monkeypatch):
    """At most 6 updates, or 2 epochs."""
    few = {
        name: dataclasses.replace(recipe, updates=min(recipe.updates, 6), epochs=min(recipe.epochs, 2))
        for name, recipe in recipes.RECIPES.items()
    }
    monkeypatch.setattr(recipes, "RECIPES", few)
