"""Work on recordings: replay, comparison, identification, diagnosis, plans, reports."""
