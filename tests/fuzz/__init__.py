"""Random inputs in their millions against the decoders and the gateway: `python -m tests.fuzz`."""
