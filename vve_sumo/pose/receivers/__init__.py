"""The port of receivers, and the kinds that are shipped: one file each, found by its name in `[pose] kind`."""
