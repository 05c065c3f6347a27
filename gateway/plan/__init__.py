"""A plan of commands for a real boat: made for a vessel, held within limits, exported."""
