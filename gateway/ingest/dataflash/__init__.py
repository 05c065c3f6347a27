"""ingest/dataflash."""
