"""The page in the browser: what a user does in five steps, by mouse (`shadow studio`)."""
