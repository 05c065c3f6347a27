"""Many recordings of many boats: one pipeline on Dask, its table, and what wears."""
