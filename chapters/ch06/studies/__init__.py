"""Small programs beside the chapter, about one idea each: `strata run 5/compute-buffers`."""
