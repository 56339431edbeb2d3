"""Studies: small programs beside the renderer, one idea each: `strata run 2/flipbook`."""
