"""Message -> quantities: pure functions, one small file per family, one table (`table.RULES`)."""
