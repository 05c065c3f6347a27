"""Watch a digital shadow from Python: pip install eclipse-zenoh, then run this beside the gateway.

python subscribe.py [tcp/HOST:7447]
"""

import json
import sys

import zenoh

config = zenoh.Config()
config.insert_json5("mode", '"client"')
config.insert_json5("connect/endpoints", json.dumps([*sys.argv[1:], "tcp/127.0.0.1:7447"][:1]))

with zenoh.open(config) as session, session.declare_subscriber("shadow/*/residual") as subscriber:
    for sample in subscriber:
        vessel, message = str(sample.key_expr).split("/")[1], json.loads(sample.payload.to_bytes())
        force, std = message["missing_surge_n"], message["missing_surge_n_std"]
        print(f"{vessel}: the model lacks {force:.1f} ± {std:.1f} N ahead", flush=True)
