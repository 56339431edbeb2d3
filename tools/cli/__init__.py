"""The command line: commands with their options, and what all of them print with."""
