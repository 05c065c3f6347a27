"""MCAP recordings of the gateway as logs."""
