"""Results as tables and sentences in the terminal, one file per kind of result."""
