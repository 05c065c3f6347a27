"""Commands by groups, listed in `gateway.cli`; `gateway.offline` and `gateway.live` do the work."""
