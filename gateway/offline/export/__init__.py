"""`shadow export`: a log in a form that other programs open, and that every command reads back."""
