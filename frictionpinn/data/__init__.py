"""Recordings: reading, checking, units, noise, excitation, DataModules."""
