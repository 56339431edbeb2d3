"""Small programs beside the chapter, about one idea each: `strata run 3/factor-folding`."""
