"""One physical effect per file, and one list of them all (`catalogue`)."""
