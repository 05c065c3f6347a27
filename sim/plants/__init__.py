"""What the follower drives: one kind of plant per file, and one table of them all (`table`)."""
