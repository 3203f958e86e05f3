"""Bands that rest on themselves, on finer grids."""

from __future__ import annotations
