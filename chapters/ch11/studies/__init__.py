"""Small programs beside the chapter, about one idea each: `strata run 8/bias-explorer`."""
