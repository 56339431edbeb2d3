"""Small programs beside the chapter, about one idea each: `strata run 12/procedural-spheres`."""
