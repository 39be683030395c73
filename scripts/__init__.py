"""Tools for changing eskin: mutants, the documents' site, tables of figures. Not installed."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""The folder of the project."""
