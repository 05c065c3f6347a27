"""Commands by groups; `gateway.cli` lists them. Their work is done in `gateway.pipelines`."""
