"""Results on the terminal: one file per kind of result, tables and a few words."""
