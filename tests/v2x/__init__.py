"""Tests of the codecs of V2X messages and of the headers that carry them."""
