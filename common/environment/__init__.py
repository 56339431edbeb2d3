"""Environments: panoramas, skies, directions and cube maps."""

from common.environment.environment import (
    Environment,
    clean,
    constant,
    read_environment,
)

__all__ = ["Environment", "clean", "constant", "read_environment"]
