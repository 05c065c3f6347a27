"""ingest/csv."""
