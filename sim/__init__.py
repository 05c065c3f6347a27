"""Physics and inference: arrays in, arrays out.

Nothing here knows of sockets, files, buses or clocks, and nothing here imports `gateway`.
"""
