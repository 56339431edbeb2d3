"""Small programs beside the chapter, about one idea each: `strata run 11/dynamic-resolution`."""
