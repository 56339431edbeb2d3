"""Scenes of cloth for tests: those that benches are measured on."""

from __future__ import annotations

from common.scene.sheets import SHEET, cloth, cloth_scene_of, sheet

__all__ = ["SHEET", "cloth", "cloth_scene_of", "sheet"]
