"""The scenes that the project makes itself, with their generators: `locate("atrium")` gives the path of one."""

from assets.scenes import SCENES, SceneInfo, locate, write

__all__ = ["SCENES", "SceneInfo", "locate", "write"]
