"""Small programs beside the chapter, about one idea each: `strata run 4/shader-chain`."""
