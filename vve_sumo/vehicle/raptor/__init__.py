"""New Eagle's Raptor: its DBC file, and the mapping that makes an interface and a simulated controller of it."""
