"""Links and logs in, messages out, messages to samples."""
