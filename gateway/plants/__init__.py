"""Which plant plays a boat, from words of the command line; plants that come as files."""
