"""glTF 2.0 files as scenes: `load_scene` is the whole interface."""

from common.gltf.load import load_scene

__all__ = ["load_scene"]
