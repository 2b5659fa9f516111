"""Dataspeed's ULC beside its DBW1 controller: the DBC file, and the mapping that makes an interface of it."""
