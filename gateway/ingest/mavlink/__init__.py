"""ingest/mavlink."""
