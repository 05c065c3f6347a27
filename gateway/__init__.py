"""Everything that touches the world: links, logs, filter, bus, recorder, commands."""
