"""Recipes of few updates, for what is not about accuracy."""

import pytest

from tests.support.recipes import few_updates


@pytest.fixture
def quick(monkeypatch):
    """At most 6 updates."""
    few_updates(monkeypatch, 6)
