"""The path through the lessons: the sections of each chapter, and how far a reader has come.

sections    the sections of all chapters in their order, and their parts of the READMEs
progress    what a reader has solved and read, kept in the user's state
next        `strata next`: where the reader is, and what comes next
"""
