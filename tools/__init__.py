"""What people do with chapters: one package for each kind of work, none of which a lesson teaches."""
