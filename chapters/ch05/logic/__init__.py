"""What both backends use and no device is needed for."""
