"""The port of receivers, and the shipped kinds, one file each, selected by name in `[pose] kind`."""
