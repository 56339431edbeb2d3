"""The fifteen lessons, and what must know all of them: `open`, the command line, the drivers of bench and site."""
