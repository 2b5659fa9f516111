"""The safety case as data, and the dossier of a test day that is made of it.

Knows rigs, records and certificates as files; opens no bus and moves nothing.
"""
