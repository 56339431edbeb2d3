"""Environments: panoramas, skies, directions and cube maps."""

from common.environment.environment import (
    ENERGIES,
    Energy,
    Environment,
    clean,
    constant,
    read_environment,
)

__all__ = ["ENERGIES", "Energy", "Environment", "clean", "constant", "read_environment"]
