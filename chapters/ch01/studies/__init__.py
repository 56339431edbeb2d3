"""Studies: small programs beside the renderer, one idea each, on both backends: `strata run 1/first-triangle`."""
