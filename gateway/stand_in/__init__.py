"""The project's own small autopilot: it drives a boat in the loop where no firmware is at hand."""
