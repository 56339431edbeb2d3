"""Small programs beside the chapter, about one idea each: `strata run 9/shading-rates`."""
