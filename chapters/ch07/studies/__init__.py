"""Small programs beside the chapter, about one idea each: `strata run 7/screen-space-reflections`."""
