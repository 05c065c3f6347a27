"""What the follower drives: one plant per file, and one list of them all (`catalogue`)."""
