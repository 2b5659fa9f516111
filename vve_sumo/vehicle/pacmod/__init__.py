"""AutonomouStuff's PACMod 3: its DBC file, and the mapping that makes an interface and a simulated controller of it."""
