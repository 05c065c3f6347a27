"""Links to boats: the only sockets and serial ports of the project, one table of their kinds."""
